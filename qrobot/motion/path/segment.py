"""A request that is served: from the via point it left to its goal, with its times."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.motion.path.blend import Blend, beta
from qrobot.motion.path.coordinates import Coordinates
from qrobot.motion.request import MoveRequest

_NOWHERE: Final = 1e-9  # rad or m; rounding


@dataclass(frozen=True)
class Schedule:
    """Times of one segment, in samples.

    Attributes:
        transition: Ta of the transition into the segment.
        length: T, from the via point it leaves to the one it reaches.
        least_resting: least Ta of a transition out of it to rest.
        resting: Ta of that transition when nothing follows.
    """

    transition: int
    length: int
    least_resting: int
    resting: int


@dataclass(frozen=True, eq=False)
class Segment:
    """A request being served, in motion coordinates (m,).

    Attributes:
        request: what was asked.
        coordinates: its coordinates.
        begin: path time of the via point it left.
        via: that via point. Shape (m,).
        target: the via point, or goal, it goes to. Shape (m,).
        schedule: its times.
        velocity: on its straight part. Shape (m,).
        arriving: joint velocity at its far end, before any transition. Shape (n,).
        end_joints: joint positions there, as an arm has them that comes along it; of a goal that moves, where that was
            when the segment was planned. Shape (n,).
    """

    request: MoveRequest
    coordinates: Coordinates
    begin: float
    via: Floats
    target: Floats
    schedule: Schedule
    velocity: Floats
    arriving: Floats
    end_joints: Floats

    @property
    def end(self) -> float:
        """Path time at which the target would be reached without a transition."""
        return self.begin + self.schedule.length

    @property
    def dwells(self) -> bool:
        """True when it stays where it is for a time that was asked for, so that there is nothing to come to rest from.

        Not with a frame that moves: the frame may be a function of `scal`, which comes to rest as the motion does.
        """
        still = bool(np.abs(self.target - self.via).max() <= _NOWHERE)
        return still and self.coordinates.fixed and (self.stays or self.request.transition_s is not None)

    @property
    def stays(self) -> bool:
        """True for the stay behind an absolute stop, which is at rest to its end whatever follows."""
        return self.request.stay_s > 0.0

    @property
    def rest_begin(self) -> float:
        """Path time at which the transition to rest begins when nothing follows."""
        return self.end - self.schedule.resting

    def scal(self, clock: float, blend: Blend, ending: bool) -> float:
        """Share of the segment that is done, 0 to 1: the s of a way from rest, smooth where the motion is.

        Args:
            clock: path time.
            blend: polynomial of the transitions.
            ending: the transition to rest has begun.
        """
        length = self.schedule.length
        if ending and not self.dwells:
            d = 2.0 * self.schedule.resting
            h = min((clock - self.rest_begin) / d, 1.0)
            return 1.0 + (d * (h - 0.5 - beta(int(blend), h)[0])) / length
        d = 2.0 * self.schedule.transition
        h = max((clock - self.begin) / d + 0.5, 0.0)
        return min(d * beta(int(blend), h)[0] / length, 1.0)
