"""The samples that a motion takes, as Figure 5 of the paper tells it: Tseg to the nearest sample, and one more.

A motion takes Tseg + dT from the beginning of the transition into it to the beginning of the transition into the next
one, or to rest: 300 ms at dT 56 ms are 5 samples, and the next motion of the figure begins after 6. The last of several
motions, which comes to rest, takes no longer than one that is passed, so its transitions lie inside its time. Tseg is
what the program asked for, or follows from the speed that it asked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import Final

import numpy as np

from qrobot.arcl.options import MotionOptions, SpeedBy
from qrobot.arcl.positions import Pos
from qrobot.arrays import Floats
from qrobot.model.transform import inverse, so3_log
from qrobot.motion import (
    TURN_PER_MM,
    ArmKinematics,
    Displacement,
    Duration,
    MotionLimits,
    MotionSpeed,
    SpeedShare,
    enough_samples,
    whole_samples,
)
from qrobot.units import M_PER_MM, RAD_PER_DEG, S_PER_MS

_NOWHERE: Final = 1e-9  # rad or m; rounding
_ROUNDING: Final = 1e-6  # of a sample


@dataclass(frozen=True, eq=False)
class SegmentTime:
    """See above.

    Attributes:
        tseg: gives Tseg.
        transition_s: Ta.
        to_rest: no other motion waits behind it.
    """

    tseg: MotionSpeed
    transition_s: float
    to_rest: bool

    def samples(self, displacement: Displacement, limits: MotionLimits, period_s: float) -> int:
        """Samples from corner to corner; with the transitions at both ends it comes to rest after 2 Ta more."""
        whole = self.tseg.samples(displacement, limits, period_s) + 1
        if self.to_rest:
            stays = float(np.abs(displacement.joints).max()) <= _NOWHERE
            whole -= (1 if stays else 2) * whole_samples(self.transition_s, period_s)
        return max(1, whole, _fewest_samples(displacement, limits, period_s))


def _fewest_samples(displacement: Displacement, limits: MotionLimits, period_s: float) -> int:
    """Samples in which no joint is faster on the straight part of its way than it may be."""
    seconds = float((np.abs(displacement.joints) / limits.v_max).max())
    return ceil(seconds / period_s - _ROUNDING)


@dataclass(frozen=True, eq=False)
class ToolTravel:
    """The tool's tip takes its way at `linear` m/s and its turn at `angular` rad/s; the longer counts.

    Attributes:
        joint_goal: of a goal given by its joints: where they and the tool's tip will be.
    """

    linear: float
    angular: float
    joint_goal: JointGoal | None = None

    def samples(self, displacement: Displacement, _limits: MotionLimits, period_s: float) -> int:
        """Samples, to the nearest."""
        tool = displacement.tool
        if self.joint_goal is not None:
            tool = self.joint_goal.travel(displacement.joints)
        if tool is None:
            return 1
        parts = ((tool[:3], self.linear), (tool[3:], self.angular))
        return whole_samples(max(float(np.linalg.norm(way)) / speed for way, speed in parts), period_s)


@dataclass(frozen=True)
class JointTravel:
    """The joint that takes longest moves at `speed`, degrees/s, or mm/s where it slides."""

    speed: float

    def samples(self, displacement: Displacement, limits: MotionLimits, period_s: float) -> int:
        """Samples, rounded up: never faster than asked."""
        speeds = self.speed * np.where(limits.prismatic, M_PER_MM, RAD_PER_DEG)
        return enough_samples(float((np.abs(displacement.joints) / speeds).max()), period_s)


@dataclass(frozen=True, eq=False)
class JointGoal:
    """Joint positions (n,) and the tool (4, 4) on the last frame."""

    kinematics: ArmKinematics
    q: Floats
    T_tool: Floats

    def travel(self, joints: Floats) -> Floats:
        """Way and turn of the tool's tip when the joints go by `joints` (n,) to the goal. Shape (6,), m and rad."""
        end, begin = (self.kinematics.forward(q) @ self.T_tool for q in (self.q, self.q - joints))
        D = inverse(end) @ begin
        return np.concatenate((D[:3, 3], so3_log(D)))


def segment_time(
    options: MotionOptions, pos: Pos, kinematics: ArmKinematics, ta_ms: float, to_rest: bool
) -> SegmentTime:
    """The time of a motion to `pos`."""
    return SegmentTime(_tseg(options, pos, kinematics), ta_ms * S_PER_MS, to_rest)


def _tseg(options: MotionOptions, pos: Pos, kinematics: ArmKinematics) -> MotionSpeed:
    if options.tseg_ms > 0.0:
        return Duration(options.tseg_ms * S_PER_MS)
    if options.speed_by is SpeedBy.TOOL and max(options.vt, options.vr) > 0.0:
        goal = None
        if isinstance(pos.target, np.ndarray):
            goal = JointGoal(kinematics, pos.target, np.eye(4) if pos.tool is None else pos.tool.value)
        vt, vr = options.vt or options.vr / TURN_PER_MM, options.vr or options.vt * TURN_PER_MM
        return ToolTravel(vt * M_PER_MM, vr * RAD_PER_DEG, goal)
    if options.speed_by is SpeedBy.JOINT:
        return JointTravel(options.jvel)
    return SpeedShare(options.share * 0.01)
