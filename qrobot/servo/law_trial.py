"""A law is tried before the arm depends on it: it has to give finite torques, and to leave time for the rest.

What a trial does not see - other poses, sensors that fail, a day with a busier machine - the guard sees in the cycle.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from qrobot.config import Robot
from qrobot.errors import ConfigError
from qrobot.hwif.registers import N_ADCS
from qrobot.realtime.clock import monotonic_ns
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.law import KP, KV, M0, MEMORY_WORDS, N_GAINS, Law, is_finite
from qrobot.servo.swap import law_at

TIMED_CALLS: Final = 1000
MOST_OF_PERIOD: Final = 0.5
OFFSET: Final = 1e-3  # rad or m, and rad/s or m/s, between reference and arm


def prove(law: Law, name: str, robot: Robot, period_ns: int) -> None:
    """Compile the law and run it at the robot's poses.

    Raises:
        ConfigError: it does not compile, gives a torque that is not finite, or takes more than half the period.
    """
    prove_finite(law, name, robot)
    longest_ns, limit_ns = typical_ns(law, robot), MOST_OF_PERIOD * period_ns
    if longest_ns > limit_ns:
        raise ConfigError(
            f"law {name} takes {longest_ns / 1000:.1f} us, and a cycle of {period_ns / 1000:.0f} us leaves it "
            f"{limit_ns / 1000:.1f}: make it faster, or lower the rate"
        )


def prove_finite(law: Law, name: str, robot: Robot) -> None:
    """Raises ConfigError when the law does not compile, or gives a torque that is not finite at one of the poses."""
    address = law.address
    for pose, q in robot.poses.items():
        arguments = _arguments(law, robot, q)
        _timed_calls(address, arguments, np.zeros(1, dtype=np.int64))
        tau = arguments[-1]
        if not is_finite(tau):
            joint = 1 + int(np.flatnonzero(~np.isfinite(tau))[0])
            raise ConfigError(f"law {name} gives joint {joint} no finite torque at the pose {pose!r}")


def typical_ns(law: Law, robot: Robot) -> float:
    """Median duration of a call."""
    lengths = np.zeros(TIMED_CALLS, dtype=np.int64)
    _timed_calls(law.address, _arguments(law, robot, robot.poses["ready"]), lengths)
    return float(np.median(lengths))


def _arguments(law: Law, robot: Robot, q: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """What the law gets of an arm near its reference, in the order of `law.ARGUMENTS`; no result yet."""
    n, control = robot.n, robot.control
    gains = np.zeros((N_GAINS, n))
    gains[KP], gains[KV], gains[M0] = control.kp, control.kv, control.inertia
    vectors = [q + OFFSET, np.full(n, OFFSET), np.zeros(n), np.array(q), np.zeros(n), np.zeros(n), np.zeros(n)]
    return (*vectors, np.zeros(N_ADCS), gains, law.values, np.zeros(MEMORY_WORDS), np.array([1e-3]), np.full(n, np.nan))


@lean_kernel
def _timed_calls(address: int, arguments: Any, lengths: Any) -> None:
    """Call the law as often as there is room in `lengths`, ns. Shape (calls,)."""
    for k in range(lengths.size):
        began = monotonic_ns()
        law_at(address)(*arguments)
        lengths[k] = monotonic_ns() - began
