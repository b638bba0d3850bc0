"""Whether the position columns of a recording are believable: counters that stand still or jump, columns exchanged.

Everything here compares what was measured with what was asked for, row by row, before anything is fitted: in cycles
with an image. In the others positions were carried on and counts stand (`ident.dropouts`), which is no fault.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from qrobot.arrays import Bools, Floats
from qrobot.config import Robot
from qrobot.modecodes import Mode
from qrobot.model.transmission import transmission_params
from qrobot.servo.memory.telemetry import Rows, sampled

STUCK_COUNTS: Final = 200  # that a motor was to turn while its counter did not: no friction holds an arm so far off
STUCK_BAND: Final = 2  # counts between which a counter may toggle and still stand
TOO_FAST: Final = 2.0  # times a motor's greatest speed: no motor turns so far in a cycle
JITTER: Final = 10  # counts that a row may add to that
SAME_COUNTS: Final = 2.0  # between a position and its counters: rounding
EXCHANGED: Final = 0.1  # of the distance that two columns keep as they stand, once they are exchanged
_FEWEST_ROWS: Final = 16  # of the shortest stretch in which a counter is looked at


def counter_faults(robot: Robot, rows: Rows, period_s: float) -> list[str]:
    """Errors of counters and positions in rows, shape (r,), one sentence for each joint.

    Of several kinds of faults the first: the others follow from it.
    """
    looked_for = (
        _exchanged(robot, rows),
        _unlike(robot, rows),
        _stuck(robot, rows, period_s),
        _slipped(robot, rows, period_s),
        _astray(robot, rows, period_s),
    )
    return next((found for found in map(list, looked_for) if found), [])


def _exchanged(robot: Robot, rows: Rows) -> Iterator[str]:
    """Pairs of joints whose counters, or positions, follow each other's references."""
    wanted = rows["q_ref"][_under_way(rows)]
    params = transmission_params(robot)
    wanted_counts = (wanted - params.q_offset) @ params.count_per_joint.T + params.count_offset
    for what, field, of in (("counters", "counts", wanted_counts), ("positions", "q", wanted)):
        off = _distances(rows[field][_under_way(rows)], of)
        for i, j in zip(*np.triu_indices(robot.n, 1), strict=True):
            if max(off[i, j], off[j, i]) < EXCHANGED * min(off[i, i], off[j, j]):
                a, b = robot.joint_names[i], robot.joint_names[j]
                yield f"the {what} of {a} follow what {b} was to do, and the reverse: two columns are exchanged"


def _distances(measured: Floats, wanted: Floats) -> Floats:
    """Root mean square from every measured column (r, n) to every column of references (r, n). Shape (n, n)."""
    if not len(measured):
        return np.zeros((measured.shape[1], wanted.shape[1]))
    return np.asarray(np.sqrt(((measured[:, :, None] - wanted[:, None, :]) ** 2).mean(axis=0)))


def _unlike(robot: Robot, rows: Rows) -> Iterator[str]:
    """Joints whose position is not that of its counters."""
    per_joint = np.abs(transmission_params(robot).count_per_joint).sum(axis=0)
    off = np.abs(rows["q"] - _positions(robot, rows["counts"])) * per_joint > SAME_COUNTS
    shares = (off & (_under_way(rows) & sampled(rows))[:, None]).mean(axis=0)
    for joint in np.flatnonzero(shares):
        percent = max(1.0, 100.0 * shares[joint])
        yield (
            f"the position of {robot.joint_names[joint]} is not that of its counters in {percent:.0f} % of the rows: "
            "they are of another robot file, or a column was changed"
        )


def _stuck(robot: Robot, rows: Rows, period_s: float) -> Iterator[str]:
    """Counters that stay within a count or two while their motor was to turn."""
    wanted = rows["q_ref"] @ robot.transmission.coupling.T / robot.transmission.rad_per_count
    seen = np.flatnonzero(sampled(rows))
    counts, under_way = rows["counts"][seen], _under_way(rows)[seen]
    for joint, name in enumerate(robot.joint_names):
        still = _still(counts[:, joint], wanted[seen, joint], under_way)
        if (at := np.flatnonzero(still)).size:
            begin, end = _stretched(counts[:, joint], int(at[0]), int(at[-1]))
            first, last = seen[begin] * period_s, seen[end] * period_s
            yield f"the encoder of {name} stands still from {first:.1f} to {last:.1f} s, though the joint was to move"


def _stretched(counts: NDArray[np.int64], begin: int, end: int) -> tuple[int, int]:
    """First and last row of a stretch from row `begin` to `end`, as far as the counter keeps within its band."""
    before = np.flatnonzero(np.abs(counts[:begin] - counts[begin]) > STUCK_BAND)
    after = np.flatnonzero(np.abs(counts[end:] - counts[end]) > STUCK_BAND)
    return int(before[-1]) + 1 if before.size else 0, end + int(after[0]) if after.size else len(counts) - 1


def _still(counts: NDArray[np.int64], wanted: Floats, under_way: Bools) -> Bools:
    """Rows in stretches, of any length, in which a counter keeps within a band that it was to leave far behind."""
    still, length = np.zeros(len(counts), np.bool_), _FEWEST_ROWS
    while length <= len(counts):
        for offset in (0, length // 2):
            blocks = (len(counts) - offset) // length
            part = slice(offset, offset + blocks * length)
            spread, far, busy = (each[part].reshape(blocks, length) for each in (counts, wanted, under_way))
            stands = (np.ptp(spread, axis=1) <= STUCK_BAND) & (np.ptp(far, axis=1) > STUCK_COUNTS) & busy.all(axis=1)
            still[part] |= np.repeat(stands, length)
        length *= 2
    return still


def _slipped(robot: Robot, rows: Rows, period_s: float) -> Iterator[str]:
    """Counters that go farther than a motor can, from an image to the next one."""
    fastest = robot.transmission.count_rates(robot.limits.v_max)
    seen = np.flatnonzero(sampled(rows))
    steps, cycles = np.diff(rows["counts"][seen], axis=0), np.diff(seen)
    follows = (np.diff(rows["tick"][seen]) == cycles) & _under_way(rows)[seen[1:]]
    jumps = (np.abs(steps) > TOO_FAST * fastest * period_s * cycles[:, None] + JITTER) & follows[:, None]
    for joint in np.flatnonzero(jumps.any(axis=0)):
        first = int(jumps[:, joint].argmax())
        yield (
            f"the counter of {robot.joint_names[joint]} jumps by {steps[first, joint]:+d} at "
            f"{seen[first + 1] * period_s:.1f} s, farther than the motor can turn in a cycle"
        )


def _astray(robot: Robot, rows: Rows, period_s: float) -> Iterator[str]:
    """Joints that are farther from their reference than the servo lets them be."""
    off = np.abs(rows["q_ref"] - rows["q"])
    astray = (off > robot.guard.following_error) & _under_way(rows)[:, None]
    for joint in np.flatnonzero(astray.any(axis=0)):
        first = int(astray[:, joint].argmax())
        yield (
            f"{robot.joint_names[joint]} is {off[first, joint]:.3g} rad (m) from where it was to be at "
            f"{first * period_s:.1f} s, where a servo would have stopped: a counter slipped or stands still, or "
            "columns are another joint's"
        )


def _positions(robot: Robot, counts: NDArray[np.int64]) -> Floats:
    """Joint positions as the servo computes them, for counters of shape (r, n)."""
    params = transmission_params(robot)
    return np.asarray(params.q_offset + (counts - params.count_offset) @ params.joint_per_count.T)


def _under_way(rows: Rows) -> Bools:
    return np.asarray(rows["mode"] == Mode.TRACKING)
