"""A law is tried before the arm depends on it: it has to give finite torques, and to leave time for the rest.

What a trial does not see - other poses, sensors that fail, a day with a busier machine - the guard sees in the cycle.
A law in somebody's file is tried in a process of its own, see `servo.laws.trial_process`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from qrobot.config import Robot
from qrobot.errors import ConfigError
from qrobot.realtime.clock import monotonic_ns
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.laws.file import law_and_line
from qrobot.servo.laws.law import ARGUMENTS, Law, is_finite
from qrobot.servo.laws.law_swap import law_at
from qrobot.servo.laws.trial_inputs import Arguments, at_extremes, at_pose, at_poses, in_motion

TIMED_CALLS: Final = 1000
CALLS_IN_MOTION: Final = 20
MOST_OF_PERIOD: Final = 0.5
_MAY_CHANGE: Final = ("memory", "tau")
_SILENT: Final = ("math domain error", "math range error", "expected a ", "complex")
"""Words of Python's errors where compiled code has NaN: roots and logarithms of negative numbers, a power of one."""

Call = Callable[..., None]


def prove(law: Law, name: str, robot: Robot, period_ns: int) -> None:
    """Compile the law and run it at the robot's poses.

    Raises:
        ConfigError: it does not compile, gives a torque that is not finite, or takes more than half the period.
    """
    prove_finite(law, name, robot)
    prove_quick(law, name, robot, period_ns)


def prove_finite(law: Law, name: str, robot: Robot) -> None:
    """Raises ConfigError when the law does not compile, or gives a torque that is not finite at one of the poses."""
    address = law.address
    for where, arguments in at_poses(law, robot):
        _timed_calls(address, arguments, np.zeros(1, dtype=np.int64))
        tau = arguments[-1]
        if not is_finite(tau):
            joint = 1 + int(np.flatnonzero(~np.isfinite(tau))[0])
            raise ConfigError(f"law {name} gives joint {joint} no finite torque {where}")


def prove_quick(law: Law, name: str, robot: Robot, period_ns: int) -> None:
    """Raises ConfigError when the law takes more than half the period, at rest or in one of many motions."""
    longest_ns, limit_ns = max(typical_ns(law, robot), longest_in_motion_ns(law, robot)), MOST_OF_PERIOD * period_ns
    if longest_ns > limit_ns:
        raise ConfigError(
            f"law {name} takes {longest_ns / 1000:.1f} us, and a cycle of {period_ns / 1000:.0f} us leaves it "
            f"{limit_ns / 1000:.1f}: make it faster, or lower the rate"
        )


def prove_harmless(law: Law, name: str, robot: Robot, call: Call, compiled: bool = False) -> None:
    """Run the law through `call` on everything it could meet.

    Args:
        compiled: `call` is machine code, which may not raise at all: a helper that was compiled before its law, with
            Numba's own options, raises where a quotient by zero is a number in the law itself.

    Raises:
        ConfigError: it raises an exception, reaches past the end of an array, or changes what it may only read.
    """
    for arguments in (*(at for _, at in at_poses(law, robot)), *in_motion(law, robot)):
        _call_once(call, name, "", arguments, compiled)
    for where, arguments in at_extremes(law, robot):
        _call_once(call, name, f" with {where}", arguments, compiled)


def _call_once(call: Call, name: str, where: str, arguments: Arguments, compiled: bool) -> None:
    before = [argument.tobytes() for argument in arguments]
    try:
        with np.errstate(all="ignore"):
            call(*arguments)
    except (IndexError, OverflowError, ValueError, ArithmeticError, TypeError) as error:
        if compiled or _is_harm(error):
            raise ConfigError(f"law {law_and_line(name, error)}{where}: {type(error).__name__}: {error}") from error
    for argument, said, bytes_before in zip(ARGUMENTS, arguments, before, strict=True):
        if argument not in _MAY_CHANGE and said.tobytes() != bytes_before:
            raise ConfigError(f"law {name} changes {argument}{where}: it may only write tau and memory")


def _is_harm(error: Exception) -> bool:
    """Whether compiled code would fail as Python did; a quotient by zero and a root of -1 are numbers there."""
    if isinstance(error, ArithmeticError):
        return "to integer" in str(error)
    return isinstance(error, IndexError) or not any(words in str(error) for words in _SILENT)


def typical_ns(law: Law, robot: Robot) -> float:
    """Median duration of a call."""
    lengths = np.zeros(TIMED_CALLS, dtype=np.int64)
    _timed_calls(law.address, at_pose(law, robot, robot.poses["ready"]), lengths)
    return float(np.median(lengths))


def longest_in_motion_ns(law: Law, robot: Robot) -> float:
    """Duration of a call in the motion that takes longest, best of several."""
    lengths, longest = np.zeros(CALLS_IN_MOTION, dtype=np.int64), 0.0
    for arguments in in_motion(law, robot):
        _timed_calls(law.address, arguments, lengths)
        longest = max(longest, float(lengths.min()))
    return longest


@lean_kernel
def _timed_calls(address: int, arguments: Any, lengths: Any) -> None:
    """Call the law as often as there is room in `lengths`, ns. Shape (calls,)."""
    for k in range(lengths.size):
        began = monotonic_ns()
        law_at(address)(*arguments)
        lengths[k] = monotonic_ns() - began
