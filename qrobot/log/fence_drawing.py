"""Fences drawn in three dimensions by Matplotlib: their edges, as far as the picture reaches."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from typing import Final

import numpy as np
from mpl_toolkits.mplot3d.axes3d import Axes3D

from qrobot.arrays import Floats
from qrobot.config.fences import Fence
from qrobot.model.transform import rpy
from qrobot.units import RAD_PER_DEG

LOOKS: Final = {"out": ("#AA3377", "-"), "in": ("#228833", (0, (4, 2)))}  # told apart without their colours too
POINTS: Final = 60  # of an edge, so that it can end where the picture does
SIDES: Final = 36  # of the rim of a cylinder
BARS: Final = 6  # of its wall
NEAR_M: Final = 1.2  # [A] further off a fence is drawn as far as the picture goes
PLANE_M: Final = 4.0  # edge of the square that is drawn of a plane
LINES: Final = 9  # of it, each way


def draw_fences(space: Axes3D, fences: Iterable[Fence]) -> None:
    """Draw the edges of fences, and the name of each, into a picture whose limits are set."""
    limits = np.array([space.get_xlim(), space.get_ylim(), space.get_zlim()])
    for fence in fences:
        colour, dashes = LOOKS[fence.keep]
        seen = [part for edge in outline(fence) for part in _inside(edge, limits)]
        for part in seen:
            space.plot(*part.T, color=colour, linestyle=dashes, linewidth=0.8)
        if seen:
            place = max((part[int(part[:, 2].argmax())] for part in seen), key=lambda point: float(point[2]))
            space.text(*place, f"{fence.name}: keep {fence.keep}", color=colour, fontsize=7, clip_on=True)


def near_points(fences: Iterable[Fence]) -> Floats:
    """Places of bodies that a picture should reach: those of boxes and cylinders about the arm. Shape (k, 3)."""
    edges = [edge for fence in fences if fence.shape != "plane" for edge in outline(fence)]
    places = np.concatenate([np.empty((0, 3)), *edges])
    near: Floats = places[np.abs(places).max(axis=1) < NEAR_M]
    return near


def outline(fence: Fence) -> list[Floats]:
    """Edges of a fence in the base frame, m; each of shape (points, 3)."""
    made = _plane() if fence.shape == "plane" else _box(fence) if fence.shape == "box" else _cylinder(fence)
    roll, pitch, yaw = (angle * RAD_PER_DEG for angle in fence.rpy_deg)
    axes, middle = rpy(roll, pitch, yaw), np.array(fence.position_m)
    return [edge @ axes.T + middle for edge in made]


def _line(begin: Iterable[float], end: Iterable[float]) -> Floats:
    return np.linspace(np.array(list(begin)), np.array(list(end)), POINTS)


def _box(fence: Fence) -> list[Floats]:
    half = np.array(fence.size_m) / 2.0
    corners = [np.array(signs) for signs in product((-1.0, 1.0), repeat=3)]
    return [
        _line(a * half, b * half)
        for k, a in enumerate(corners)
        for b in corners[k + 1 :]
        if np.count_nonzero(a != b) == 1
    ]


def _cylinder(fence: Fence) -> list[Floats]:
    radius, half = fence.radius_m or 0.0, (fence.length_m or 0.0) / 2.0
    turn = np.linspace(0.0, 2.0 * np.pi, SIDES + 1)
    rim = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.zeros(SIDES + 1)])
    ends = [rim + np.array([0.0, 0.0, z]) for z in (-half, half)]
    return [*ends, *(_line(low, high) for low, high in zip(*(end[: -1 : SIDES // BARS] for end in ends), strict=True))]


def _plane() -> list[Floats]:
    half = PLANE_M / 2.0
    at = np.linspace(-half, half, LINES)
    along = [_line((-half, y, 0.0), (half, y, 0.0)) for y in at]
    return along + [_line((x, -half, 0.0), (x, half, 0.0)) for x in at]


def _inside(edge: Floats, limits: Floats) -> list[Floats]:
    """The pieces of an edge (points, 3) within the limits (3, 2) of the picture."""
    seen = ((edge >= limits[:, 0] - 1e-9) & (edge <= limits[:, 1] + 1e-9)).all(axis=1)
    cuts = np.flatnonzero(np.diff(seen.astype(int))) + 1
    return [part for part, kept in zip(np.split(edge, cuts), np.split(seen, cuts), strict=True) if kept[0]]
