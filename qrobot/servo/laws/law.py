"""Control laws: compiled functions of (reference, measured, model terms, sensors, gains) -> torque.

A law is called once a cycle. Its arguments are float64 arrays in SI units; it names those that it uses, in any order:

| argument   | shape  | unit          | meaning                                                                      |
|------------|--------|---------------|------------------------------------------------------------------------------|
| `q_ref`    | (n,)   | rad (m)       | interpolated setpoint                                                        |
| `v_ref`    | (n,)   | rad/s         | its derivative                                                               |
| `a_ref`    | (n,)   | rad/s^2       | its second derivative                                                        |
| `q`        | (n,)   | rad (m)       | measured position                                                            |
| `v`        | (n,)   | rad/s         | estimated velocity, see `servo.kernels.velocity`                              |
| `gravity`  | (n,)   | N m (N)       | torque that carries the arm at `q`, already zero where compensation is off   |
| `friction` | (n,)   | N m (N)       | torque the drives lose at `v_ref`, viscous and smoothed Coulomb, joint side  |
| `sensors`  | (8,)   | V             | the board's analogue channels                                                |
| `payload`  | (10,)  | kg, m         | in force: mass, first moments, inertia (xx yy zz xy xz yz) in the last frame |
| `gains`    | (3, n) | -             | rows `KP`, `KV`, `M0` of numbers from the robot file                         |
| `settings` | (32,)  | the law's own | in the order in which the law declares them, see `Setting`                   |
| `memory`   | (64,)  | the law's own | kept from cycle to cycle, zeroed at power-up; from `SIGNALS_AT` on logged    |
| `dt`       | (1,)   | s             | time since the cycle before                                                  |
| `tau`      | (n,)   | N m (N)       | the result, joint side                                                       |

What a law returns goes through the guard: it cannot exceed the torque limits, and a NaN stops the arm. Laws are Numba
functions of one signature behind a pointer (`Law`), hence swappable: the compiled cycle need not know them.
"""

from __future__ import annotations

import ast
import inspect
import math
import re
import textwrap
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property
from itertools import takewhile
from pathlib import Path
from typing import Any, Final, overload

import numpy as np
from numba import types

from qrobot.arrays import Floats
from qrobot.errors import ConfigError
from qrobot.realtime.jit import kernel
from qrobot.realtime.pointer import COMPILE_ERRORS, KernelPointer
from qrobot.servo.laws.python_calls import refuse_python_calls
from qrobot.wire.vocabulary import LONGEST_SIGNAL, N_SIGNALS

KP, KV, M0 = range(3)  # rows of `gains`
N_GAINS: Final = 3
N_SETTINGS: Final = 32
MEMORY_WORDS: Final = 64
SIGNALS_AT: Final = MEMORY_WORDS - N_SIGNALS  # from here on the memory is in the log
ARGUMENTS: Final = (
    "q_ref", "v_ref", "a_ref", "q", "v", "gravity", "friction", "sensors", "payload", "gains", "settings",
    "memory", "dt", "tau",
)  # fmt: skip

MOST_SAID: Final = 400  # characters of what Numba says of a mistake
_PLACE: Final = re.compile(r'File "([^"]+)", line (\d+)')
NO_LINEAR_ALGEBRA: Final = (
    "linear algebra (numpy.linalg, np.dot, @) needs SciPy, which QRobot does without: write the sums out "
    "in loops, or make it a law of expressions (@casadi_law)"
)
_ADVICE: Final = ("-", "During", "^", "Failed in ")

_VECTOR = types.Array(types.float64, 1, "C")
_MATRIX = types.Array(types.float64, 2, "C")
LAW_SIGNATURE: Final = types.void(*(_MATRIX if name == "gains" else _VECTOR for name in ARGUMENTS))

LawBody = Callable[..., None]


@dataclass(frozen=True)
class Setting:
    """A number that a law lets its users choose.

    Attributes:
        name: in the deployment file.
        default: when nobody chooses.
        low, high: what is allowed, both included.
        unit, meaning: for people.
    """

    name: str
    default: float
    low: float
    high: float
    unit: str
    meaning: str

    def __post_init__(self) -> None:
        if not self.low <= self.default <= self.high:
            raise ConfigError(f"law setting {self.name}: {self.low} <= {self.default} <= {self.high} does not hold")

    def checked(self, value: float) -> float:
        """`value`. Raises ConfigError when it is not allowed."""
        if not self.low <= value <= self.high:
            raise ConfigError(
                f"law setting {self.name} = {value:g} {self.unit}: allowed are {self.low:g} to {self.high:g}"
            )
        return float(value)


class Law(KernelPointer):
    """A law as a pointer, with its settings: the cycle that takes it is compiled once, for all laws, and cached.

    Attributes:
        settings: what can be chosen, in the order of the numbers.
        values: what was chosen. Shape (32,).
        signals: names of the numbers it leaves in the memory from `SIGNALS_AT` on, for the log.
        compliant: it lets the arm give way, and goes over to other settings by itself, without a bump, at any time.
    """

    def __init__(
        self,
        function: LawBody,
        settings: tuple[Setting, ...] = (),
        values: Floats | None = None,
        signals: tuple[str, ...] = (),
        compliant: bool = False,
    ) -> None:
        super().__init__(function, LAW_SIGNATURE)
        if len(settings) > N_SETTINGS:
            raise ConfigError(f"a law has at most {N_SETTINGS} settings, not {len(settings)}")
        self.settings, self.signals, self.compliant = settings, checked_signals(signals), compliant
        self.values = np.zeros(N_SETTINGS)
        self.values[: len(settings)] = [setting.default for setting in settings]
        if values is not None:
            self.values[:] = values
        self.__doc__ = function.__doc__

    @cached_property
    def address(self) -> int:
        """Address of the compiled code, while the law lives. Raises ConfigError when the law cannot be compiled."""
        try:
            return super().address
        except COMPILE_ERRORS as error:
            raise ConfigError(f"the law does not compile: {without_advice(error)}") from error

    @property
    def chosen(self) -> dict[str, float]:
        """The settings by name."""
        return dict(zip((setting.name for setting in self.settings), self.values.tolist(), strict=False))

    def with_settings(self, chosen: Mapping[str, float]) -> Law:
        """The same law with other settings; those not named keep their value. Raises ConfigError for bad ones."""
        names = [setting.name for setting in self.settings]
        values = self.values.copy()
        for name, value in chosen.items():
            if name not in names:
                raise ConfigError(f"the law has no setting {name!r}{_proposal(name, names)}")
            values[names.index(name)] = self.settings[names.index(name)].checked(value)
        return self.with_values(values)

    def with_values(self, values: Floats) -> Law:
        """The same law with these settings, shape (32,)."""
        other = copy(self)
        other.values = values
        return other


@overload
def law(function: LawBody) -> Law: ...


@overload
def law(*, settings: tuple[Setting, ...] = ..., signals: tuple[str, ...] = ...) -> Callable[[LawBody], Law]: ...


def law(
    function: LawBody | None = None, *, settings: tuple[Setting, ...] = (), signals: tuple[str, ...] = ()
) -> Law | Callable[[LawBody], Law]:
    """Make a law of a function of some of `ARGUMENTS`; it is compiled when it is first used.

    Args:
        function: fills `tau`. With the compiler on it has to be something Numba understands.
        settings: numbers its users may choose, in the order of `settings`.
        signals: names of at most 8 numbers for the log, which the law leaves in `memory[SIGNALS_AT:]` in this order.

    Raises:
        ConfigError: it takes something that is no argument of a law, or no `tau`; or it prints or raises.
    """
    if function is None:
        return lambda body: _law(body, settings, signals)
    return _law(function, settings, signals)


def _law(function: LawBody, settings: tuple[Setting, ...], signals: tuple[str, ...]) -> Law:
    names = argument_names(function, ARGUMENTS)
    if "tau" not in names:
        raise ConfigError(f"law {function.__name__} takes no tau: that is what it has to fill")
    refuse_python_calls(function)
    body = kernel(function if names == ARGUMENTS else _with_all_arguments(function))
    return Law(body, settings, signals=signals)


def checked_signals(names: tuple[str, ...]) -> tuple[str, ...]:
    """`names`. Raises ConfigError when they are too many, not each its own, or not short identifiers."""
    for name in names:
        if not (name.isidentifier() and name.isascii() and len(name) <= LONGEST_SIGNAL):
            raise ConfigError(f"signal {name!r}: letters, digits and underscores are allowed, at most {LONGEST_SIGNAL}")
    if len(set(names)) < len(names) or len(names) > N_SIGNALS:
        raise ConfigError(f"signals {', '.join(names)}: at most {N_SIGNALS}, each with a name of its own")
    return tuple(names)


def argument_names(function: Callable[..., Any], known: tuple[str, ...]) -> tuple[str, ...]:
    """Arguments of a law's function. Raises ConfigError for those that are not in `known`."""
    names = tuple(inspect.signature(function).parameters)
    for name in names:
        if name not in known:
            raise ConfigError(f"law {function.__name__} takes {name!r}, which is none of {', '.join(known)}")
    return names


def _with_all_arguments(function: LawBody) -> LawBody:
    """The same function with all of `ARGUMENTS`, at the same lines of the same file, where Numba keeps its cache."""
    definition = _definition(function)
    if definition is None:
        return _passed_on(function)
    definition.decorator_list, definition.returns = [], None
    definition.args.args = [ast.arg(name) for name in ARGUMENTS]
    tree = ast.Module([definition], type_ignores=[])
    ast.increment_lineno(tree, function.__code__.co_firstlineno - 1)
    scope: dict[str, LawBody] = {}
    code = compile(ast.fix_missing_locations(tree), function.__code__.co_filename, "exec", dont_inherit=True)
    exec(code, function.__globals__, scope)
    return scope[function.__name__]


def _definition(function: LawBody) -> ast.FunctionDef | None:
    """Syntax of a plain function; None without its source, or when it is more than that."""
    try:
        definition = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    except (OSError, SyntaxError):
        return None
    if not isinstance(definition, ast.FunctionDef) or function.__closure__ is not None or definition.args.defaults:
        return None
    return definition


def _passed_on(function: LawBody) -> LawBody:
    """Make a function that takes all the arguments and passes on those that `function` wants; it cannot be cached."""
    names = inspect.signature(function).parameters
    scope: dict[str, Any] = {"inner": kernel(function)}
    exec(f"def outer({', '.join(ARGUMENTS)}):\n    inner({', '.join(names)})\n", scope)
    outer: LawBody = scope["outer"]
    outer.__doc__ = function.__doc__
    return outer


def without_advice(error: Exception) -> str:
    """Numba's message without its advice and the source: where the last complaint is, and what comes first."""
    if isinstance(error, ImportError) and "linear algebra" in str(error):
        return NO_LINEAR_ALGEBRA
    lines = [line.strip() for line in str(error).splitlines()]
    places = [found for line in lines if (found := _PLACE.match(line))]
    before_source = list(takewhile(lambda line: not _PLACE.match(line), lines))
    said = " ".join([line for line in before_source if line and not line.startswith(_ADVICE)][:3])[:MOST_SAID]
    return f"{Path(places[-1][1]).resolve()}, line {places[-1][2]}: {said}" if places else said


def _proposal(name: str, names: list[str]) -> str:
    if not names:
        return ": it has none"
    near = get_close_matches(name, names, n=1)
    return f"; did you mean {near[0]!r}?" if near else f"; there are: {', '.join(names)}"


def is_finite(vector: Floats) -> bool:
    """No NaN and no infinity. Shape (n,)."""
    return all(map(math.isfinite, vector.tolist()))
