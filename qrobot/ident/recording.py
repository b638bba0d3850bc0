"""Whether a recording can be trusted: encoders that stand still, torques at their limit.

Both are looked for in the rows alone, before anything is fitted, and named by joint and time.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from qrobot.config import Robot
from qrobot.errors import IdentificationError
from qrobot.hwif.registers import DAC_ZERO
from qrobot.servo.modes import Mode
from qrobot.servo.telemetry import Rows

Bools = NDArray[np.bool_]

STUCK_COUNTS: Final = 200  # that a motor was to turn while its counter did not: no friction holds an arm so far off
SATURATED_SHARE: Final = 0.02  # of the time under way
DAC_MARGIN: Final = 2  # counts within which a DAC word is at its end
_LIMITED_BIT: Final = 8  # of the flags: the first joint at its torque limit


def check_recording(robot: Robot, rows: Rows, period_s: float) -> None:
    """Refuse rows, shape (r,), that would mislead a fit.

    Raises:
        IdentificationError: names every joint that is wrong, what is, and when.
    """
    if not len(rows):
        return
    if faults := [*_stuck(robot, rows, period_s), *_saturated(robot, rows, period_s)]:
        raise IdentificationError("; ".join(faults) + ". Look at `qrobot log plot`, and record again")


def limited(rows: Rows) -> Bools:
    """Where the torque of a joint was at its limit. Shape (r, n)."""
    dac = rows["dac"]
    at_end = (dac <= DAC_MARGIN) | (dac >= 2 * DAC_ZERO - 1 - DAC_MARGIN)
    said = rows["flags"][:, None] >> (_LIMITED_BIT + np.arange(dac.shape[1])) & 1
    return np.asarray(at_end | (said == 1))


def _stuck(robot: Robot, rows: Rows, period_s: float) -> Iterator[str]:
    """Counters that stay the same while their motor was to turn."""
    transmission = robot.transmission
    wanted = rows["q_ref"] @ transmission.coupling.T / transmission.rad_per_count
    under_way = rows["mode"] == Mode.TRACKING
    for joint, name in enumerate(robot.joint_names):
        changes = (np.diff(rows["counts"][:, joint]) != 0) | ~under_way[1:]
        begin = np.concatenate([[0], np.flatnonzero(changes) + 1])
        end = np.append(begin[1:], len(rows)) - 1
        still = np.abs(wanted[end, joint] - wanted[begin, joint]) > STUCK_COUNTS
        if (worst := np.flatnonzero(still)).size:
            first, last = begin[worst[0]] * period_s, end[worst[-1]] * period_s
            yield f"the encoder of {name} stands still from {first:.1f} to {last:.1f} s, though the joint was to move"


def _saturated(robot: Robot, rows: Rows, period_s: float) -> Iterator[str]:
    """Joints whose torque was at its limit for more than a moment."""
    under_way = rows["mode"] == Mode.TRACKING
    at_limit = limited(rows) & under_way[:, None]
    for joint in np.flatnonzero(at_limit.sum(axis=0) > SATURATED_SHARE * max(under_way.sum(), 1)):
        seconds, first = at_limit[:, joint].sum() * period_s, at_limit[:, joint].argmax() * period_s
        yield f"the torque of {robot.joint_names[joint]} was at its limit for {seconds:.1f} s, first at {first:.1f} s"
