"""The chain of link frames: modified Denavit-Hartenberg rows (Craig), and vectors carried along it.

Frame i-1 to frame i is Rx(alpha) Tx(a) Rz(theta) Tz(d); the joint adds to theta when it turns and to d when it slides.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from qrobot.config.robot import Robot
from qrobot.config.values import Bools, Floats
from qrobot.realtime.jit import kernel


class ChainParams(NamedTuple):
    """Modified DH rows of n links, m and rad. Shapes (n,)."""

    cos_alpha: Floats
    sin_alpha: Floats
    a: Floats
    d: Floats
    theta: Floats
    prismatic: Bools


def chain_params(robot: Robot) -> ChainParams:
    """Collect the geometry of `robot` for the kernels; fresh, writable arrays of one Numba type."""
    g = robot.geometry
    return ChainParams(
        cos_alpha=np.cos(g.alpha_rad),
        sin_alpha=np.sin(g.alpha_rad),
        a=np.array(g.a_m),
        d=np.array(g.d_m),
        theta=np.array(g.theta_rad),
        prismatic=np.array(robot.prismatic),
    )


@kernel
def joint_angle(q: Floats, chain: ChainParams, i: int) -> float:
    """Angle about z between the frames of joint i, rad."""
    return float(chain.theta[i] if chain.prismatic[i] else chain.theta[i] + q[i])


@kernel
def joint_slide(q: Floats, chain: ChainParams, i: int) -> float:
    """Distance along z between the frames of joint i, m."""
    return float(chain.d[i] + q[i] if chain.prismatic[i] else chain.d[i])


@kernel
def to_link(c: float, s: float, ca: float, sa: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A vector of frame i-1 in frame i: Rz(theta)' Rx(alpha)' v, from the cosines and sines of theta and alpha."""
    lifted = ca * y + sa * z
    return c * x + s * lifted, c * lifted - s * x, ca * z - sa * y


@kernel
def to_parent(c: float, s: float, ca: float, sa: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A vector of frame i in frame i-1: Rx(alpha) Rz(theta) v; the inverse of `to_link`."""
    lifted = s * x + c * y
    return c * x - s * y, ca * lifted - sa * z, sa * lifted + ca * z
