"""Whether a recording can be trusted: numbers that are none, lost rows, counters, torques at their limit.

All is looked for in the rows alone, before anything is fitted, and named by joint and time.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from qrobot.arrays import Bools
from qrobot.config import Robot
from qrobot.config.collision import NO_TORQUES
from qrobot.errors import IdentificationError
from qrobot.hwif.registers import DAC_ZERO
from qrobot.ident.counters import counter_faults
from qrobot.ident.dropouts import long_dropout
from qrobot.modecodes import Mode
from qrobot.servo.memory.published_state import FLAG_NO_TORQUES
from qrobot.servo.memory.telemetry import VECTORS, Rows, sampled

SATURATED_SHARE: Final = 0.02  # of the time under way
DAC_MARGIN: Final = 2  # counts within which a DAC word is at its end
LOST_SHARE: Final = 0.02  # of the cycles under way that may be missing [A]
MOST_GAPS: Final = 10  # places at which they are missing, however few: a pass ends at each of them [A]
NEW_LOG_S: Final = 5.0  # a longer gap is between two logs, or a pause of the recorder
SAME_PERIOD: Final = 0.01  # share by which rows may be farther apart than the log's header says
_STANDS: Final = 1e-6  # rad/s (m/s): slower is rounding
_CLIPPED_BIT: Final = 8  # of the flags: from here on the number of joints at their torque limit,
_MOST_JOINTS: Final = 0xFF  # in eight bits, and above them the frames missed
_AT_LIMIT: Final = 1.0 - 1e-9  # of the limit to which a torque was clipped


def check_recording(robot: Robot, rows: Rows, period_s: float) -> None:
    """Refuse rows, shape (r,), that would mislead a fit.

    Raises:
        IdentificationError: names everything that is wrong, of which joint, and when.
    """
    if not len(rows):
        return
    if (rows["flags"] & FLAG_NO_TORQUES).any():
        raise IdentificationError(f"nothing can be fitted: {NO_TORQUES}")
    faults = [*_no_numbers(robot, rows, period_s)] or [
        *_lost(rows, period_s),
        *counter_faults(robot, rows, period_s),
        *_saturated(robot, rows, period_s),
    ]
    if faults:
        raise IdentificationError("; ".join(faults) + ". Look at `qrobot log plot`, and record again")


def _limited(robot: Robot, rows: Rows) -> Bools:
    """True where the torque of a joint was at its limit. Shape (r, n)."""
    clipped = rows["flags"] >> _CLIPPED_BIT & _MOST_JOINTS > 0  # the flags tell how many joints, and not which
    at_limit = np.abs(rows["tau"]) >= _AT_LIMIT * robot.guard.tau_max
    return np.asarray(_word_at_end(rows) | (clipped[:, None] & at_limit))


def sound(rows: Rows, period_s: float) -> Bools:
    """True where a row can be measured by: no torque at its limit, no frame missed, no images lost, and no joint that
    something else moves. Shape (r,).
    """
    whole = ~_word_at_end(rows).any(axis=1) & (rows["flags"] >> _CLIPPED_BIT == 0)
    return np.asarray(whole & ~long_dropout(rows, period_s) & ~_led(rows).any(axis=1))


def _led(rows: Rows) -> Bools:
    """True where a joint is driven by torque and moves: a hand leads it, or what a tool touches. Shape (r, n).

    Its torque is what the servo makes of the robot file, and nobody knows the hand's share. Its reference is where the
    joint is, or stands at the end of its range, and has its speed without ever accelerating.
    """
    stood = np.diff(rows["q_ref"], axis=0, prepend=np.nan) == 0.0
    follows = (rows["q_ref"] == rows["q"]) & sampled(rows)[:, None]
    moves = (np.abs(rows["v"]) > _STANDS) & (np.abs(rows["v_ref"]) > _STANDS)
    return np.asarray(moves & (rows["a_ref"] == 0.0) & (follows | stood))


def _word_at_end(rows: Rows) -> Bools:
    """True where the DAC of a motor shows no more. Shape (r, n)."""
    dac = rows["dac"]
    return np.asarray((dac <= DAC_MARGIN) | (dac >= 2 * DAC_ZERO - 1 - DAC_MARGIN))


def _no_numbers(robot: Robot, rows: Rows, period_s: float) -> Iterator[str]:
    """Columns in which something is not finite."""
    for field, meaning in VECTORS:
        wrong = ~np.isfinite(rows[field])
        for joint in np.flatnonzero(wrong.any(axis=0)):
            first, many = int(wrong[:, joint].argmax()) * period_s, int(wrong[:, joint].sum())
            what = f"{meaning.split(',')[0]} ({field}) of {robot.joint_names[joint]}"
            yield f"{what} is not a finite number in {many} of {len(rows)} rows, first at {first:.1f} s"


def _lost(rows: Rows, period_s: float) -> Iterator[str]:
    """Cycles that are not in the log, and rows that are not as far apart as its header says."""
    steps = np.diff(rows["tick"])
    within = (steps > 0) & (steps < NEW_LOG_S / period_s) & (rows["mode"][1:] == Mode.TRACKING)
    gaps = np.flatnonzero(within & (steps > 1))
    lost, there = int((steps[gaps] - 1).sum()), int(within.sum())
    if gaps.size > MOST_GAPS and lost > LOST_SHARE * (lost + there):
        yield (
            f"{lost} of {lost + there} cycles under way are missing at {gaps.size} places, first at "
            f"{gaps[0] * period_s:.1f} s: rows were lost, and a pass ends at each of them"
        )
    if not rows["t_ns"].any():  # what ships with QRobot has no times
        return
    apart = np.diff(rows["t_ns"])[within] / np.maximum(steps[within], 1) * 1e-9
    if apart.size and abs(float(np.median(apart)) / period_s - 1.0) > SAME_PERIOD:
        yield (
            f"rows are {1e3 * float(np.median(apart)):.3g} ms apart and not {1e3 * period_s:.3g}, as their header says"
        )


def _saturated(robot: Robot, rows: Rows, period_s: float) -> Iterator[str]:
    """Joints whose torque was at its limit for more than a moment."""
    under_way = rows["mode"] == Mode.TRACKING
    at_limit = _limited(robot, rows) & under_way[:, None]
    for joint in np.flatnonzero(at_limit.sum(axis=0) > SATURATED_SHARE * max(under_way.sum(), 1)):
        seconds, first = at_limit[:, joint].sum() * period_s, at_limit[:, joint].argmax() * period_s
        yield f"the torque of {robot.joint_names[joint]} was at its limit for {seconds:.1f} s, first at {first:.1f} s"
