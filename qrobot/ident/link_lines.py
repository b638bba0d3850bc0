"""The bodies of an arm as lines: from one joint to the next, as its Denavit-Hartenberg rows lead.

A robot file knows no surfaces, but where its bodies are: along x of the frame before a joint and then along z of the
joint's own. The base is a line from the floor, the hand one from the last frame through the flange.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot

HAND_M: Final = 0.1  # beyond the flange: room for a tool
SPACING_M: Final = 0.08  # of points along a line, at most


class LinkLines:
    """Lines of the bodies of one robot: base, what each joint carries, hand.

    Attributes:
        lengths: of the lines, m; of one that slides the least. Shape (n + 2,).
    """

    def __init__(self, robot: Robot) -> None:
        geometry, self._robot = robot.geometry, robot
        slides = [np.where(robot.prismatic, end, 0.0) for end in (robot.limits.q_min, robot.limits.q_max)]
        low, high = (geometry.d_m + slide for slide in slides)
        longest = np.maximum(np.abs(low), np.abs(high))
        shortest = np.maximum(np.maximum(low, -high), 0.0)  # none where the range has it slide through its joint
        base, hand = geometry.base_height_m, geometry.flange_m + HAND_M
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
        robot, geometry, at = self._robot, self._robot.geometry, np.zeros((len(q), 3))
        x, y, z = (np.broadcast_to(axis, at.shape) for axis in np.eye(3))
        corners = [at - geometry.base_height_m * z, at]
        for i, alpha in enumerate(geometry.alpha_rad.tolist()):
            slide, turn = (q[:, [i]], 0.0) if robot.prismatic[i] else (0.0, q[:, [i]])
            corner = at + geometry.a_m[i] * x
            y, z = np.cos(alpha) * y + np.sin(alpha) * z, np.cos(alpha) * z - np.sin(alpha) * y
            at = corner + (geometry.d_m[i] + slide) * z
            cos, sin = np.cos(geometry.theta_rad[i] + turn), np.sin(geometry.theta_rad[i] + turn)
            x, y = cos * x + sin * y, cos * y - sin * x
            corners += [corner, at]
        return [*corners, at + (geometry.flange_m + HAND_M) * z]


def _shares(length: float) -> Floats:
    """Shares of the way from end to end, as many points as a line of that length needs; one where it has none."""
    count = 1 + int(np.ceil(length / SPACING_M))
    return np.linspace(0.0, 1.0, count)[:, None] if count > 1 else np.zeros((1, 1))
