"""Small motions, velocities and forces carried between two frames of one rigid body (Paul 1981, chapter 4; B-09).

`T` is always the pose of frame c in frame r. A twist is [v; w], the velocity of the frame's origin and the angular
velocity; a wrench is [f; m], the force and the moment about the frame's origin; a small motion is [d; delta]. All have
shape (6,), each in the axes of its own frame. The two maps are transposes of each other's inverse, so power is the same
in either frame: `wrench_to_parent(T, w) @ twist_of_parent == w @ twist_to_child(T, twist_of_parent)`.
"""

from __future__ import annotations

import numpy as np

from qrobot.arrays import Floats


def cross_matrix(p: Floats) -> Floats:
    """`cross_matrix(p) @ v == cross(p, v)`. Shape (3, 3)."""
    return np.array([[0.0, -p[2], p[1]], [p[2], 0.0, -p[0]], [-p[1], p[0], 0.0]])


def twist_to_child(T: Floats, twist: Floats) -> Floats:
    """The twist, or small motion, seen in frame c: `v_c = R' (v + w x p), w_c = R' w`. Shape (6,)."""
    v, w = twist[:3], twist[3:]
    R, p = T[:3, :3], T[:3, 3]
    return np.concatenate((R.T @ (v + cross_matrix(w) @ p), R.T @ w))


def wrench_to_parent(T: Floats, wrench: Floats) -> Floats:
    """The wrench seen in frame r: `f_r = R f, m_r = R m + p x f_r`. Shape (6,)."""
    R, p = T[:3, :3], T[:3, 3]
    force: Floats = R @ wrench[:3]
    return np.concatenate((force, R @ wrench[3:] + cross_matrix(p) @ force))
