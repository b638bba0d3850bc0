"""Whether an arm, led through joint space, stays clear of the floor, of its column and of itself.

As far as its file tells: bodies are lines (`link_lines`) with a thickness that is assumed, and the floor is below, as
gravity has it. The hand, with room for a tool, keeps farther away than the others. An arm that does not stand upright
has no column: what carries it is not known. Of what stands around the arm it knows the fences; the rest is for whoever
starts the plan to keep away.
"""

from __future__ import annotations

from functools import cache
from itertools import combinations, pairwise
from typing import Final

import numpy as np

from qrobot.arrays import Bools, Floats
from qrobot.config import Robot
from qrobot.errors import IdentificationError
from qrobot.fences.fence_set import FenceSet, distance_words
from qrobot.ident.link_lines import HAND_M, LinkLines, stands_upright, up_of
from qrobot.units import MM_PER_M

FLOOR: Final = 0.25  # m that wrist and flange stay above the floor
COLUMN: Final = 0.30  # m from the column that they keep below the shoulder
APART: Final = 0.16  # m between the lines of two bodies: either is as thick as a forearm [A]
NEIGHBOURS: Final = 0.2  # m along the arm: bodies nearer to each other always are
SPARE: Final = 0.005  # m that a plan keeps from fences beyond their margins, for what is looked at elsewhere [A]
_STEP: Final = 0.1  # rad or m of the joint that moves most, between two looks


class Clearance:
    """Looks at poses and ways of one robot, with `fences` around it."""

    def __init__(self, robot: Robot, fences: FenceSet | None = None) -> None:
        self._fences = None if fences is None else fences.wider(SPARE)
        self._geometry, self._link_lines = robot.geometry, LinkLines(robot)
        self._up, self._stands = up_of(robot), stands_upright(robot)
        lengths = self._link_lines.lengths
        long = np.flatnonzero(lengths).tolist()
        self._pairs = [(j, k) for j, k in combinations(long, 2) if lengths[j + 1 : k].sum() > NEIGHBOURS]

    def of_poses(self, q: Floats) -> Bools:
        """True for each of the positions (m, n) that is clear. Shape (m,)."""
        lines = self._link_lines.lines(q)
        clear = self._hand(lines[-1]) & self._above_floor(lines[2:])
        for j, k in self._pairs:
            clear[clear] = _distance(lines[j][clear], lines[k][clear]) >= APART
        return clear

    def of_pose(self, q: Floats) -> bool:
        """Whether `q` (n,) is clear."""
        return bool(self.of_poses(q[None])[0])

    def check_ready(self, q: Floats) -> None:
        """Look at the pose `ready` (n,), by which a plan gets everywhere.

        Raises IdentificationError: it is not clear.
        """
        reason = self._too_near_a_fence(q)
        if not reason and not self.of_pose(q):
            reason = "it is too near to the floor, the column or the arm itself"
        if reason:
            raise IdentificationError(
                f"the pose 'ready', by which all moves of a plan come: {reason}; move it in the robot file"
            )

    def _too_near_a_fence(self, q: Floats) -> str:
        """The part of the arm that is too near to a fence at `q` (n,), and that fence; empty when none is."""
        if self._fences is None:
            return ""
        near = min(self._fences.nearness(q), key=lambda near: near.distance - near.margin)
        if near.distance >= near.margin:
            return ""
        kept = f"plans keep {MM_PER_M * near.margin:g} mm away"
        return f"{near.body} is {distance_words(near.fence, near.distance)}, and {kept}"

    def of_way(self, begin: Floats, end: Floats) -> bool:
        """Whether all of a straight way between two joint positions (n,) is."""
        return self.of_path(np.stack([begin, end]))

    def of_path(self, q: Floats) -> bool:
        """Whether all of the straight ways from each of the positions (m, n) to the next are."""
        return bool(self.of_poses(q).all() and self.of_poses(_looks(q)).all()) and all(
            self.of_fences(*both) for both in pairwise(q)
        )

    def of_fences(self, begin: Floats, end: Floats) -> bool:
        """Whether no fence is in the straight way between two joint positions (n,)."""
        fences = self._fences
        if fences is None:
            return True
        return bool((fences.slack(begin) >= 0.0).all()) and fences.clear_share(begin, end) == 1.0

    def _hand(self, hand: Floats) -> Bools:
        """Wrist and flange are above the floor, and outside the column, if any, where they are below the shoulder."""
        wrist, end = hand[:, 0], hand[:, -1]
        flange = wrist + self._geometry.flange_m / (self._geometry.flange_m + HAND_M) * (end - wrist)
        points = np.stack([wrist, flange], axis=1)
        height = points @ self._up
        aside = np.linalg.norm(points - height[..., None] * self._up, axis=-1)
        above_floor = height + self._geometry.base_height_m >= FLOOR
        outside = (height >= 0.0) | (aside >= COLUMN) | (not self._stands)
        return np.asarray((above_floor & outside).all(axis=1))

    def _above_floor(self, bodies: list[Floats]) -> Bools:
        """Whether all these bodies, which do not stand on the floor, are at least as far above it as they are thick."""
        lowest = np.concatenate([body @ self._up for body in bodies], axis=1).min(axis=1)
        return np.asarray(lowest + self._geometry.base_height_m >= 0.5 * APART)


def _looks(q: Floats) -> Floats:
    """Looks at the straight ways from each of the positions (m, n) to the next, all ends included. Shape (looks, n)."""
    steps = np.diff(q, axis=0)
    counts = 2 + np.ceil(np.abs(steps).max(axis=1) / _STEP).astype(np.int64)
    shares = np.concatenate([_shares(count) for count in counts.tolist()])
    return np.asarray(np.repeat(q[:-1], counts, axis=0) + shares * np.repeat(steps, counts, axis=0))


@cache
def _shares(count: int) -> Floats:
    """Shares of a way, both ends included. Shape (count, 1)."""
    return np.linspace(0.0, 1.0, count)[:, None]


def _distance(first: Floats, second: Floats) -> Floats:
    """Shortest between points (m, k, 3) and points (m, l, 3). Shape (m,)."""
    squares = (first**2).sum(axis=2)[:, :, None] + (second**2).sum(axis=2)[:, None] - 2.0 * first @ second.mT
    return np.asarray(np.sqrt(np.maximum(squares.min(axis=(1, 2)), 0.0)))
