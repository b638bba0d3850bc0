"""Control laws written as CasADi expressions, compiled without a C compiler.

    @casadi_law
    def pd(q_ref, v_ref, q, v, gains):
        return gains[KP, :].T * (q_ref - q) + gains[KV, :].T * (v_ref - v)

The function takes symbols of the arguments of a law (`servo.laws.law`, `tau` excepted) and returns the torques, or the
torques and the next memory. It may also take `robot`, the robot file, and `arm`, its rigid-body model for
`codegen.rigid_body`. It is called once for each robot; what the cycle runs is the compiled expression.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, overload

from qrobot.codegen import compile_function
from qrobot.codegen.laws import law_function
from qrobot.config import Robot
from qrobot.errors import CodegenError, ConfigError
from qrobot.hwif.registers import N_ADCS
from qrobot.servo.laws.law import (
    ARGUMENTS,
    MEMORY_WORDS,
    N_GAINS,
    N_SETTINGS,
    Law,
    Setting,
    argument_names,
    checked_signals,
)
from qrobot.servo.memory.telemetry import N_PAYLOAD

EXTRAS: Final = ("robot", "arm")
_INPUTS: Final = ARGUMENTS[:-1]


class CasadiLaw:
    """A law as an expression; `for_robot` compiles it."""

    def __init__(
        self,
        build: Callable[..., Any],
        settings: tuple[Setting, ...] = (),
        signals: tuple[str, ...] = (),
        compliant: bool = False,
    ) -> None:
        self._build, self._settings, self._signals = build, settings, checked_signals(signals)
        self._compliant = compliant
        self._names = argument_names(build, (*EXTRAS, *_INPUTS))
        self.__doc__ = build.__doc__

    def for_robot(self, robot: Robot) -> Law:
        """The law for one robot. Raises ConfigError when the expression cannot be built or translated."""
        name = self._build.__name__
        sizes = dict.fromkeys(("q_ref", "v_ref", "a_ref", "q", "v", "gravity", "friction"), robot.n)
        sizes |= {"sensors": N_ADCS, "payload": N_PAYLOAD, "settings": N_SETTINGS, "memory": MEMORY_WORDS, "dt": 1}
        try:
            function, in_place = law_function(name, self._build, self._names, _INPUTS, sizes, robot, N_GAINS)
            body = compile_function(function, in_place, matrices=("gains",)).kernel
        except CodegenError as error:
            raise ConfigError(f"law {name}: {error}") from error
        body.__doc__ = body.__doc__ or self.__doc__  # two robots of a kind share one
        return Law(body, self._settings, signals=self._signals, compliant=self._compliant)


@overload
def casadi_law(build: Callable[..., Any]) -> CasadiLaw: ...


@overload
def casadi_law(
    *, settings: tuple[Setting, ...] = ..., signals: tuple[str, ...] = ...
) -> Callable[[Callable[..., Any]], CasadiLaw]: ...


def casadi_law(
    build: Callable[..., Any] | None = None,
    *,
    settings: tuple[Setting, ...] = (),
    signals: tuple[str, ...] = (),
) -> CasadiLaw | Callable[[Callable[..., Any]], CasadiLaw]:
    """Make a `CasadiLaw` of a function of symbols; see `servo.laws.law.law`.

    Raises ConfigError when it takes what is no argument of a law.
    """
    if build is None:
        return lambda function: CasadiLaw(function, settings, signals)
    return CasadiLaw(build, settings, signals)
