"""Modified Denavit-Hartenberg rows (Craig, "Introduction to Robotics", chapter 3) of any chain of joint axes.

A joint's frame may be turned about its own axis and shifted along it: it moves as before. Each frame is put so that its
x is the common normal of its axis and the next one, which is what the rows ask for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.model.transform import inverse, rot_z, transform

_PARALLEL: Final = 1e-9  # sine of the angle between two axes
_TINY: Final = 1e-12  # m, rad: rounding


@dataclass(frozen=True, eq=False)
class DenavitHartenberg:
    """Rows Rx(alpha) Tx(a) Rz(theta) Tz(d) of n joints, and where their frames stand in those that were given.

    Attributes:
        alpha, a, theta, d: rad, m. Shapes (n,).
        T_base_0: frame 0 in the frame the first axis was given in: a turn about z and a lift. Shape (4, 4).
        T_joint_frame: frame i in the joint's own, a turn about its axis and a shift along it. Shape (n, 4, 4).
    """

    alpha: Floats
    a: Floats
    theta: Floats
    d: Floats
    T_base_0: Floats
    T_joint_frame: Floats


def denavit_hartenberg(T_previous_joint: Sequence[Floats], T_last_tip: Floats) -> DenavitHartenberg:
    """Rows of a chain: each joint's frame, with z along its axis, in the one before it. Shapes (4, 4).

    The last frame stands where its axis is nearest to the one before, and its x is that of the tip where the tip's z is
    along the last axis.
    """
    adjust = [_at_next_axis(T) for T in T_previous_joint]
    adjust.append(_last(adjust[-1], T_previous_joint[-1], T_last_tip))
    rows = [inverse(adjust[i]) @ T @ adjust[i + 1] for i, T in enumerate(T_previous_joint)]
    return DenavitHartenberg(
        alpha=_clean([np.arctan2(-A[1, 2], A[2, 2]) for A in rows]),
        a=_clean([A[0, 3] for A in rows]),
        theta=_clean([np.arctan2(-A[0, 1], A[0, 0]) for A in rows]),
        d=_clean([A[1:3, 2] @ A[1:3, 3] for A in rows]),
        T_base_0=adjust[0],
        T_joint_frame=np.array(adjust[1:]),
    )


def _at_next_axis(T: Floats) -> Floats:
    """Turn about z and shift along z of a frame, so that its x meets the axis z of `T` at a right angle. (4, 4)."""
    axis, point = T[:3, 2], T[:3, 3]
    across = np.array([-axis[1], axis[0]])
    sine = float(np.linalg.norm(across))
    if sine > _PARALLEL:
        x = across / sine if across[0] >= -_TINY * sine else -across / sine
        along = (point[2] * axis[2] - point @ axis) / (sine * sine)
        height = point[2] + along * axis[2]
    else:
        reach = float(np.linalg.norm(point[:2]))
        x, height = (point[:2] / reach if reach > _TINY else np.array([1.0, 0.0])), 0.0
    return transform(rot_z(float(np.arctan2(x[1], x[0]))), [0.0, 0.0, 0.0 if abs(height) < _TINY else height])


def _last(before: Floats, T: Floats, T_last_tip: Floats) -> Floats:
    """The same for the last frame, which no axis follows."""
    in_row = inverse(before) @ T
    meets = np.hypot(*in_row[:2, 2]) > _PARALLEL
    shift = -float(in_row[1:3, 2] @ in_row[1:3, 3]) if meets else 0.0
    straight = np.hypot(*T_last_tip[:2, 2]) < _PARALLEL
    turn = float(np.arctan2(T_last_tip[1, 0], T_last_tip[0, 0])) if straight else 0.0
    return transform(rot_z(turn), [0.0, 0.0, 0.0 if abs(shift) < _TINY else shift])


def _clean(values: Sequence[Any]) -> Floats:
    """Rounding taken away where a row is meant to have a zero. Shape (n,)."""
    numbers = np.array(values, dtype=np.float64)
    return np.where(np.abs(numbers) < _TINY, 0.0, numbers)
