"""Recordings of an arm that was led by hand: smoothed within a tolerance, slowed down to what the arm can, joined.

A hand trembles, and hesitates at the ends. Smoothing is the widest Gaussian average over time, forwards and backwards
alike, whose path stays within the tolerance at the same instant: measured at the flange, and at points `BESIDE_M` away
from its centre, so that orientation counts as well. It begins and ends at rest where the recording does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import ConfigError, MotionError
from qrobot.model.arm import Arm
from qrobot.motion import MotionLimits, motion_limits
from qrobot.rccl.setpoints import Setpoints

BESIDE_M: Final = 0.1  # from the centre of the flange: half of what a gripper reaches [A]
STILL: Final = 1e-3  # rad (m) from the first or last place that do not count as motion [A]
WIDEST_S: Final = 0.5  # standard deviation of an average [A]; a wider one is another motion
STEPS: Final = 12  # of the search for the width: to 0.1 ms
TAIL: Final = 4.0  # standard deviations at which the average ends
JOINING_SHARE: Final = 0.25  # of the speeds and accelerations, between two recordings [A]
JOINED: Final = 1e-6  # rad (m) that need no joining
QUINTIC_SPEED, QUINTIC_ACCELERATION = 1.875, 5.7735  # the greatest of a quintic from rest to rest over 1 in 1 s
ROOM: Final = 0.98  # of speed and acceleration that are used
ROUNDS: Final = 6  # of slowing down and smoothing anew


def smoothed(recording: Setpoints, robot: Robot, tolerance_m: float) -> Setpoints:
    """A recording without its trembling, which the arm can do: slower where it was too fast for that.

    Args:
        tolerance_m: of the flange and of points `BESIDE_M` beside it.

    Raises:
        ConfigError: the tolerance is not above zero, or the recording is another robot's. MotionError: the arm does not
            move, cannot be slowed down so far, or a joint leaves its range.
    """
    _require_robot(recording, robot)
    if not 0.0 < tolerance_m < np.inf:
        raise ConfigError(f"a tolerance of {1e3 * tolerance_m:g} mm: a number above 0 is needed")
    arm, limits, period_s = Arm(robot), motion_limits(robot), recording.period_us * 1e-6
    led = trimmed(recording)
    for _ in range(ROUNDS):
        width = _widest(led.q, arm, tolerance_m, WIDEST_S / period_s)
        found = replace(led, q=_averaged(led.q, width))
        slower = _excess(found, limits)
        if slower <= 1.0:
            found.check(limits, "the smoothed recording")
            return found
        led = _stretched(led, 1.05 * slower)
    raise MotionError(f"the recording trembles too much for {1e3 * tolerance_m:g} mm: allow more, or lead the arm anew")


def deviation(one: Floats, other: Floats, arm: Arm) -> float:
    """Farthest that the flange, or a point `BESIDE_M` beside it, is apart on two paths (m, n) at an instant, m."""
    apart = (_points(arm, a) - _points(arm, b) for a, b in zip(one, other, strict=True))
    return max(float(np.linalg.norm(each, axis=1).max()) for each in apart)


def trimmed(recording: Setpoints) -> Setpoints:
    """A recording from just before the arm moves until it has come to rest. Raises MotionError when it hardly does."""
    q = recording.q
    moved = np.flatnonzero(np.abs(q - q[0]).max(axis=1) > STILL)
    moves = np.flatnonzero(np.abs(q - q[-1]).max(axis=1) > STILL)
    if not moved.size or not moves.size:
        raise MotionError("nothing is recorded: the arm stands still")
    led = q[max(0, moved[0] - 1) : moves[-1] + 2].copy()
    led[0], led[-1] = q[0], q[-1]
    return replace(recording, q=led)


def joined(parts: Sequence[Setpoints], robot: Robot) -> Setpoints:
    """Several recordings as one, with slow motions of the joints between their ends.

    Raises:
        ConfigError: there is none, or they are not of this robot, with one sample period.
    """
    if not parts:
        raise ConfigError("there is nothing to join")
    if len({(part.robot, part.period_us) for part in parts}) > 1:
        told = ", ".join(f"{part.robot} every {part.period_us} us" for part in parts)
        raise ConfigError(f"only recordings of one arm and one sample period can be joined, not {told}")
    _require_robot(parts[0], robot)
    limits, period_s = motion_limits(robot), parts[0].period_us * 1e-6
    rows = [parts[0].q]
    for before, after in pairwise(parts):
        rows += [_between(before.q[-1], after.q[0], limits, period_s), after.q]
    return replace(parts[0], q=np.concatenate(rows))


def _require_robot(recording: Setpoints, robot: Robot) -> None:
    if recording.robot != robot.name:
        raise ConfigError(f"the recording was made for {recording.robot}, this is {robot.name}")


def _points(arm: Arm, q: Floats) -> Floats:
    """Centre of the flange and two points beside it. Shape (3, 3)."""
    T = arm.flange(q)
    return np.asarray(T[:3, 3] + BESIDE_M * np.array([np.zeros(3), T[:3, 0], T[:3, 1]]))


def _averaged(q: Floats, width: float) -> Floats:
    """Average with a Gaussian of `width` samples, which begins and ends at rest. Longer by its tails. Shape (m, n)."""
    tail = max(1, round(TAIL * width))
    weights = np.exp(-0.5 * (np.arange(-tail, tail + 1) / max(width, 1e-3)) ** 2)
    longer = np.concatenate((np.repeat(q[:1], 2 * tail, axis=0), q, np.repeat(q[-1:], 2 * tail, axis=0)))
    return np.stack([np.convolve(column, weights / weights.sum(), "valid") for column in longer.T], axis=1)


def _widest(q: Floats, arm: Arm, tolerance_m: float, widest: float) -> float:
    """Width in samples of the widest average within the tolerance."""
    low, high = 0.0, widest
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        tail = max(1, round(TAIL * middle))
        near = deviation(_averaged(q, middle)[tail : tail + len(q)], q, arm) <= tolerance_m
        low, high = (middle, high) if near else (low, middle)
    return low


def _excess(found: Setpoints, limits: MotionLimits) -> float:
    """Factor by which a motion has to take longer for the joints' limits; at most 1 when it keeps them."""
    period_s = found.period_us * 1e-6
    v = np.diff(found.q, axis=0) / period_s
    a = np.diff(v, axis=0) / period_s
    speed = float((np.abs(v) / limits.v_max).max())
    return max(speed, float(np.sqrt((np.abs(a) / limits.a_max).max()))) / ROOM


def _stretched(led: Setpoints, factor: float) -> Setpoints:
    """The same path, `factor` times as long."""
    count = len(led.q)
    instants = np.linspace(0.0, count - 1.0, max(count, round(count * factor)))
    return replace(led, q=np.stack([np.interp(instants, np.arange(count), column) for column in led.q.T], axis=1))


def _between(start: Floats, end: Floats, limits: MotionLimits, period_s: float) -> Floats:
    """Quintic from rest to rest, without its ends; empty where there is nothing to go. Shape (m, n)."""
    way = end - start
    if np.abs(way).max() <= JOINED:
        return np.empty((0, start.size))
    by_speed = QUINTIC_SPEED * np.abs(way) / (JOINING_SHARE * limits.v_max)
    by_acceleration = np.sqrt(QUINTIC_ACCELERATION * np.abs(way) / (JOINING_SHARE * limits.a_max))
    samples = int(np.ceil(max(by_speed.max(), by_acceleration.max()) / period_s)) + 1
    s = np.arange(1, samples)[:, None] / samples
    return np.asarray(start + way * s**3 * (10.0 - 15.0 * s + 6.0 * s**2))
