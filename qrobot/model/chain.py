"""The chain of link frames: modified Denavit-Hartenberg rows (Craig), and vectors carried along it.

Frame i-1 to frame i is Rx(alpha) Tx(a) Rz(theta) Tz(d); the joint adds to theta when it turns and to d when it slides.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from qrobot.arrays import Bools, Floats
from qrobot.config.robot import Robot
from qrobot.model.vec3 import Vec
from qrobot.realtime.jit import lean_kernel
from qrobot.realtime.sine import sine_cosine

LinkRotation = tuple[float, float, float, float]


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


@lean_kernel
def link_turn(q: Floats, chain: ChainParams, i: int) -> LinkRotation:
    """The rotation of frame i in frame i-1, as cosine and sine of theta and of alpha."""
    theta = chain.theta[i] if chain.prismatic[i] else chain.theta[i] + q[i]
    sine, cosine = sine_cosine(theta)
    return cosine, sine, chain.cos_alpha[i], chain.sin_alpha[i]


@lean_kernel
def link_origin(q: Floats, chain: ChainParams, i: int) -> Vec:
    """The origin of frame i in frame i-1, m."""
    d = chain.d[i] + q[i] if chain.prismatic[i] else chain.d[i]
    return chain.a[i], -chain.sin_alpha[i] * d, chain.cos_alpha[i] * d


@lean_kernel
def to_link(turn: LinkRotation, v: Vec) -> Vec:
    """A vector of frame i-1 in frame i: Rz(theta)' Rx(alpha)' v."""
    c, s, ca, sa = turn
    lifted = ca * v[1] + sa * v[2]
    return c * v[0] + s * lifted, c * lifted - s * v[0], ca * v[2] - sa * v[1]


@lean_kernel
def to_parent(turn: LinkRotation, v: Vec) -> Vec:
    """A vector of frame i in frame i-1: Rx(alpha) Rz(theta) v; the inverse of `to_link`."""
    c, s, ca, sa = turn
    lifted = s * v[0] + c * v[1]
    return c * v[0] - s * v[1], ca * lifted - sa * v[2], sa * lifted + ca * v[2]
