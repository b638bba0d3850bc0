"""The way of an arm against its fences: when a motion is asked for, when it turns into another, and at each sample.

A request is judged as a motion from rest to rest on its straight line. A transition leaves that line, so it is looked
at before it is entered; where it would come too near a fence it is not made, and the arm comes to rest at the via point
first. A motion that begins elsewhere than was thought when it was asked for is looked at before the arm leaves its
rest. Of what nobody can know beforehand, a goal that moves or complies, each setpoint is looked at, and where a stop of
the joints that began with it would end. A Cartesian path whose motion is skipped or ended by a monitor is left only
where a stop of the joints keeps off the fences, or where the joints cannot stop on it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.fences.fence_set import RESOLUTION_M, FenceSet
from qrobot.motion.path.blend import Blend
from qrobot.motion.path.coordinates import JOINTS, Coordinates
from qrobot.motion.path.path_piece import BlendSettings, PathPiece
from qrobot.motion.path.segment import Segment
from qrobot.motion.path.setpoint_history import History, motion_of
from qrobot.motion.planning.geometric_path import PROBES, GeometricPath
from qrobot.motion.planning.joint_stop import joint_stop_s
from qrobot.motion.world.limits import MotionLimits

STOP_PROBES: Final = np.linspace(0.0, 1.0, 4)  # [A] of the way of a stop
WHAT: Final = "the motion"
_LOOK_S: Final = 0.02  # [A] of a transition: who turns back in it with 40 m/s^2 gets RESOLUTION_M out
_LEAST_LOOKS: Final = 8  # [A] at a transition


@dataclass(eq=False)
class FenceCheck:
    """Judge of one arm's motions by its fences.

    Attributes:
        fences: of the arm.
        floor: slack that a motion from where the arm rested last has to keep; None before it has rested.
    """

    fences: FenceSet
    floor: Floats | None = field(default=None)

    def check_way(self, geometry: GeometricPath, start: Floats, what: str) -> None:
        """Raise FenceCrossed when the line from the joint positions `start` (n,) comes too near a fence."""
        coordinates, via, target = geometry.coordinates, geometry.via, geometry.target

        def joints_at(share: float, near: Floats) -> Floats:
            return coordinates.solve_at(via + share * (target - via), near)

        self.fences.check_path(joints_at, start, what, _line_bends(coordinates, 0.0))

    def check_entry(self, segment: Segment, piece: PathPiece, settings: BlendSettings, near: Floats, what: str) -> None:
        """Raise FenceCrossed when the transition `piece` into `segment`, in its coordinates, or what follows on its
        line comes too near a fence; or what the coordinates raise: Unreachable, JointLimit or Singular.
        """
        end = max(piece.end, segment.end)

        def joints_at(share: float, near: Floats) -> Floats:
            state = piece.state(piece.start + share * (end - piece.start), settings)
            return segment.coordinates.solve_at(state[0], near)

        looks = max(_LEAST_LOOKS, math.ceil(piece.length * settings.period_s / _LOOK_S))
        bends = [piece.length * look / looks / (end - piece.start) for look in range(1, looks + 1)]
        bends += _line_bends(segment.coordinates, bends[-1])
        self.fences.check_path(joints_at, joints_at(0.0, near), what, [share for share in bends if share < 1.0])

    def rests_at(self, q: Floats) -> None:
        """Remember how near the arm is at rest at `q` (n,): it may stay there, and leave."""
        self.floor = self.fences.floor(q)

    def judge(self, q: Floats) -> None:
        """Raise FenceCrossed when a setpoint (n,) of a way that was looked at is too near a fence after all."""
        self.fences.check(q, self._kept(q) - RESOLUTION_M, WHAT, 1.0)  # between two places that were looked at

    def judge_stop(self, points: History, period_s: float, limits: MotionLimits, blend: Blend) -> None:
        """Raise FenceCrossed when a stop of the joints from the newest of some setpoints would end too near a fence."""
        state = motion_of(points, period_s)
        q, v = state[:2]
        seconds, _ = joint_stop_s(state, limits, blend)
        for share in STOP_PROBES:
            there = q + v * (share * (0.5 * seconds + period_s))
            self.fences.check(there, self._kept(q), WHAT, 1.0)

    def _kept(self, q: Floats) -> Floats:
        """The floor; that of `q` (n,) before the arm has rested anywhere."""
        if self.floor is None:
            self.rests_at(q)
        return self.fences.floor(q) if self.floor is None else self.floor


def _line_bends(coordinates: Coordinates, begin: float) -> list[float]:
    """Shares of a way that is a line from the share `begin` on: the places at which a line of the tool is looked at."""
    if coordinates is JOINTS:
        return []
    return [begin + (1.0 - begin) * probe / (PROBES - 1) for probe in range(1, PROBES - 1)]
