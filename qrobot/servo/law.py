"""Control laws: compiled functions of (reference, measured, model terms, sensors, gains) -> torque.

A law is called once a cycle, with arrays of shape (n,) in SI units unless said otherwise:

| argument   | unit            | meaning                                                                      |
|------------|-----------------|------------------------------------------------------------------------------|
| `q_ref`    | rad (m)         | interpolated setpoint                                                        |
| `v_ref`    | rad/s           | its derivative                                                               |
| `a_ref`    | rad/s^2         | its second derivative                                                        |
| `q`        | rad (m)         | measured position                                                            |
| `v`        | rad/s           | estimated velocity, see `servo.velocity`                                     |
| `gravity`  | N m (N)         | torque that carries the arm at `q`, already zero where compensation is off   |
| `friction` | N m (N)         | torque the drives lose at `v_ref`, viscous and smoothed Coulomb, joint side  |
| `sensors`  | -               | the board's analogue channels in volts. Shape (8,)                           |
| `gains`    | see `LawGains`  | rows of numbers from the robot file. Shape (3, n): Kp, Kv, M0                |
| `memory`   | the law's own   | kept from cycle to cycle, zeroed at power-up. Shape (64,)                    |
| `tau`      | N m (N)         | the result, joint side                                                       |

What a law returns goes through the guard: it cannot exceed the torque limits, and a NaN stops the arm. Laws are Numba
functions of one signature behind a pointer (`Law`), hence swappable: the compiled cycle need not know them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from numba import njit, types

from qrobot.errors import ConfigError
from qrobot.realtime.jit import jit_disabled
from qrobot.realtime.pointer import KernelPointer

KP, KV, M0 = range(3)  # rows of `gains`
N_GAINS: Final = 3
MEMORY_WORDS: Final = 64

_VECTOR = types.Array(types.float64, 1, "C")
_MATRIX = types.Array(types.float64, 2, "C")
LAW_SIGNATURE: Final = types.void(*[_VECTOR] * 8, _MATRIX, _VECTOR, _VECTOR)

Body = Callable[..., None]


class Law(KernelPointer):
    """A compiled law as a pointer: the cycle that takes it is compiled once, for all laws, and cached on disk."""

    def __init__(self, body: Body) -> None:
        super().__init__(body, LAW_SIGNATURE)
        self.__doc__ = body.__doc__


def law(function: Body) -> Law:
    """Compile a law for the cycle. Raises Numba's typing error when it does not fit `LAW_SIGNATURE`."""
    if jit_disabled():
        return Law(function)
    try:
        return Law(njit(LAW_SIGNATURE, cache=True, nogil=True, error_model="numpy")(function))
    except RuntimeError:  # no source file to keep a cache beside: a notebook or a prompt
        return Law(njit(LAW_SIGNATURE, nogil=True, error_model="numpy")(function))


@law
def pd(
    q_ref: Any,
    v_ref: Any,
    a_ref: Any,
    q: Any,
    v: Any,
    gravity: Any,
    friction: Any,
    sensors: Any,
    gains: Any,
    memory: Any,
    tau: Any,
) -> None:
    """Proportional and derivative feedback alone: tau = Kp (q_ref - q) + Kv (v_ref - v)."""
    for j in range(tau.size):
        tau[j] = gains[KP, j] * (q_ref[j] - q[j]) + gains[KV, j] * (v_ref[j] - v[j])


@law
def qrobot(
    q_ref: Any,
    v_ref: Any,
    a_ref: Any,
    q: Any,
    v: Any,
    gravity: Any,
    friction: Any,
    sensors: Any,
    gains: Any,
    memory: Any,
    tau: Any,
) -> None:
    """QRobot's law (QRobot paper, section 6): PD, friction compensation on all joints, gravity on joints 2 and 3.

    tau = Kp (q_ref - q) + Kv (v_ref - v) + friction(v_ref) + gravity(q)
    """
    for j in range(tau.size):
        feedback = gains[KP, j] * (q_ref[j] - q[j]) + gains[KV, j] * (v_ref[j] - v[j])
        tau[j] = feedback + friction[j] + gravity[j]


@law
def qrobot_acceleration(
    q_ref: Any,
    v_ref: Any,
    a_ref: Any,
    q: Any,
    v: Any,
    gravity: Any,
    friction: Any,
    sensors: Any,
    gains: Any,
    memory: Any,
    tau: Any,
) -> None:
    """QRobot's law with acceleration feed-forward of a constant inertia: ... + M0 a_ref."""
    for j in range(tau.size):
        feedback = gains[KP, j] * (q_ref[j] - q[j]) + gains[KV, j] * (v_ref[j] - v[j])
        tau[j] = feedback + friction[j] + gravity[j] + gains[M0, j] * a_ref[j]


LAWS: Final[dict[str, Law]] = {"pd": pd, "qrobot": qrobot, "qrobot+a": qrobot_acceleration}
DEFAULT_LAW: Final = "qrobot"


def find_law(name: str) -> Law:
    """The shipped law called `name`. Raises ConfigError naming those there are."""
    try:
        return LAWS[name]
    except KeyError:
        raise ConfigError(f"no control law {name!r}; there are: {', '.join(LAWS)}") from None
