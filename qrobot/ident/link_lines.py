"""The bodies of an arm as lines: from one joint to the next, as its Denavit-Hartenberg rows lead.

A robot file knows no surfaces, but where its bodies are: along x of the frame before a joint and then along z of the
joint's own. The base of an arm that stands is a line from the floor, which is where gravity leads; of one that hangs,
or is mounted on a wall, nothing is known of what carries it. The hand is a line from the last frame through the flange.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot

HAND_M: Final = 0.1  # beyond the flange: room for a tool
SPACING_M: Final = 0.08  # of points along a line, at most
STANDS: Final = 0.9  # cosine between the first axis and up: an arm that leans more does not stand on the floor [A]
_WEIGHTLESS: Final = 0.1  # m/s2 of gravity that tells no direction: the arm stands as its base frame does [A]


def up_of(robot: Robot) -> Floats:
    """Direction against gravity in the base frame, of length 1. Shape (3,)."""
    gravity = robot.geometry.gravity_m_s2
    strength = float(np.linalg.norm(gravity))
    return np.array([0.0, 0.0, 1.0]) if strength < _WEIGHTLESS else np.asarray(-gravity / strength)


def stands_upright(robot: Robot) -> bool:
    """Whether the first axis points up, or nearly: the arm stands on what is below it."""
    alpha = float(robot.geometry.alpha_rad[0])
    axis = np.array([0.0, -np.sin(alpha), np.cos(alpha)])
    return bool(axis @ up_of(robot) >= STANDS)


class LinkLines:
    """Lines of the bodies of one robot: base, what each joint carries, hand.

    Attributes:
        lengths: of the lines, m; of one that slides the least. Shape (n + 2,).
    """

    def __init__(self, robot: Robot) -> None:
        geometry = self._geometry = robot.geometry
        self._prismatic, alpha = robot.prismatic, geometry.alpha_rad
        self._rows = np.column_stack([geometry.a_m, np.cos(alpha), np.sin(alpha)]).tolist()
        slides = [np.where(robot.prismatic, end, 0.0) for end in (robot.limits.q_min, robot.limits.q_max)]
        low, high = (geometry.d_m + slide for slide in slides)
        longest = np.maximum(np.abs(low), np.abs(high))
        shortest = np.maximum(np.maximum(low, -high), 0.0)  # none where the range has it slide through its joint
        base, hand = geometry.base_height_m if stands_upright(robot) else 0.0, geometry.flange_m + HAND_M
        self._foot = -base * up_of(robot)
        self.lengths = np.concatenate([[base], np.abs(geometry.a_m) + shortest, [hand]])
        pieces = np.column_stack([np.abs(geometry.a_m), longest]).ravel()
        self._shares = [_shares(length) for length in (base, *pieces.tolist(), hand)]

    def lines(self, q: Floats) -> list[Floats]:
        """Points along each body at positions (m, n), in the base frame, m. Shapes (m, points, 3)."""
        corners = self._corners(q)
        pieces = [
            begin[:, None] + share * (end - begin)[:, None]
            for (begin, end), share in zip(pairwise(corners), self._shares, strict=True)
        ]
        inner = [np.concatenate(pieces[i : i + 2], axis=1) for i in range(1, len(pieces) - 1, 2)]
        return [pieces[0], *inner, pieces[-1]]

    def _corners(self, q: Floats) -> list[Floats]:
        """Begin, bend and end of the lines. Shapes (m, 3)."""
        geometry, at = self._geometry, np.zeros((len(q), 3))
        x, y, z = (np.broadcast_to(axis, at.shape) for axis in np.eye(3))
        turn = geometry.theta_rad + np.where(self._prismatic, 0.0, q)
        cosines, sines, along = np.cos(turn), np.sin(turn), geometry.d_m + np.where(self._prismatic, q, 0.0)
        corners = [at + self._foot, at]
        for i, (a, cos_alpha, sin_alpha) in enumerate(self._rows):
            corner = at + a * x
            y, z = cos_alpha * y + sin_alpha * z, cos_alpha * z - sin_alpha * y
            at = corner + along[:, i : i + 1] * z
            cos, sin = cosines[:, i : i + 1], sines[:, i : i + 1]
            x, y = cos * x + sin * y, cos * y - sin * x
            corners += [corner, at]
        return [*corners, at + (geometry.flange_m + HAND_M) * z]


def _shares(length: float) -> Floats:
    """Shares of the way from end to end, as many points as a line of that length needs; one where it has none."""
    count = 1 + int(np.ceil(length / SPACING_M))
    return np.linspace(0.0, 1.0, count)[:, None] if count > 1 else np.zeros((1, 1))
