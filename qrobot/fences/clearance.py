"""Distances of an arm from each of its fences, from its joint positions, as one kernel."""

from __future__ import annotations

import math

from qrobot.arrays import Floats
from qrobot.fences.distance import axes_apart, axis_inside, axis_outside
from qrobot.fences.table import (
    CAPSULE_WORDS,
    CAPSULES,
    CHAIN,
    CHAIN_WORDS,
    LINKS,
    N_CAPSULES,
    N_JOINTS,
    N_PAIRS,
    N_SHAPES,
    PAIRS,
    SHAPE_WORDS,
    SHAPES,
    TOOL,
)
from qrobot.model.chain import to_parent
from qrobot.model.vec3 import Vec, add, combine, cross
from qrobot.realtime.jit import lean_kernel
from qrobot.realtime.sine import sine_cosine


@lean_kernel
def clearances(q: Floats, words: Floats, work: Floats, rows: Floats, capsules: Floats) -> int:
    """Distance of the arm at `q` (n,) from each fence, m, below zero where one is entered.

    Args:
        q: joint positions. words: see `fences.table`. work: filled with where the capsules are. Shape (N_WORK,).
        rows: filled with the distances, that of the arm from itself behind the shapes. Shape (N_ROWS,).
        capsules: filled with the number of the capsule that is nearest, for each row. Shape (N_ROWS,).

    Returns:
        The number of rows that were filled.
    """
    place_capsules(q, words, work)
    n_shapes = int(words[N_SHAPES])
    for k in range(n_shapes):
        rows[k] = math.inf
        capsules[k] = -1.0
        shape_row(words, work, k, rows, capsules)
    rows[n_shapes] = math.inf
    capsules[n_shapes] = -1.0
    for k in range(int(words[N_PAIRS])):
        i, j = int(words[PAIRS + 2 * k]), int(words[PAIRS + 2 * k + 1])
        apart = axes_apart(end_of(work, i, 0), end_of(work, i, 3), end_of(work, j, 0), end_of(work, j, 3))
        apart -= radius_of(words, i) + radius_of(words, j)
        if apart < rows[n_shapes]:
            rows[n_shapes], capsules[n_shapes] = apart, float(j)
    return n_shapes + 1


@lean_kernel
def place_capsules(q: Floats, words: Floats, work: Floats) -> None:
    """Both ends of each capsule in the base frame, into `work`."""
    x, y, z, origin = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    for frame in range(int(words[N_JOINTS]) + 1):
        if frame > 0:
            at = CHAIN + CHAIN_WORDS * (frame - 1)
            ca, sa, a, d, theta = words[at], words[at + 1], words[at + 2], words[at + 3], words[at + 4]
            if words[at + 5] != 0.0:
                d += q[frame - 1]
            else:
                theta += q[frame - 1]
            sine, cosine = sine_cosine(theta)
            turn = (cosine, sine, ca, sa)
            origin = add(origin, combine(x, y, z, (a, -sa * d, ca * d)))
            before = x, y, z
            x = combine(before[0], before[1], before[2], to_parent(turn, (1.0, 0.0, 0.0)))
            y = combine(before[0], before[1], before[2], to_parent(turn, (0.0, 1.0, 0.0)))
            z = cross(x, y)
        for i in range(int(words[N_CAPSULES])):
            at = CAPSULES + CAPSULE_WORDS * i
            if int(words[at]) == frame:
                for side in range(0, 6, 3):
                    p = (words[at + 1 + side], words[at + 2 + side], words[at + 3 + side])
                    end = add(origin, combine(x, y, z, p))
                    work[6 * i + side], work[6 * i + side + 1], work[6 * i + side + 2] = end[0], end[1], end[2]


@lean_kernel
def shape_row(words: Floats, work: Floats, k: int, rows: Floats, capsules: Floats) -> None:
    """Distance of what moves of the arm from shape `k`, and the capsule that is nearest, into row `k`.

    The base stands still, perhaps inside a fence: it would hide how far off the others are.
    """
    at = SHAPES + SHAPE_WORDS * k
    kind, bodies = int(words[at]), int(words[at + 2])
    half = (words[at + 4], words[at + 5], words[at + 6])
    for i in range(int(words[N_CAPSULES])):
        of_tool = words[CAPSULES + CAPSULE_WORDS * i + 8] != 0.0
        if words[CAPSULES + CAPSULE_WORDS * i] == 0.0 or (bodies & (TOOL if of_tool else LINKS)) == 0:
            continue
        a, b = in_shape(words, at, end_of(work, i, 0)), in_shape(words, at, end_of(work, i, 3))
        radius = radius_of(words, i)
        if words[at + 1] != 0.0:
            distance = axis_inside(kind, half, a, b) - radius
        else:
            distance = axis_outside(kind, half, a, b, rows[k] + radius) - radius
        if not distance >= rows[k]:  # NaN too
            rows[k], capsules[k] = distance, float(i)


@lean_kernel
def in_shape(words: Floats, at: int, p: Vec) -> Vec:
    """A point of the base frame in that of the shape whose words begin at `at`."""
    x, y, z = p[0] - words[at + 16], p[1] - words[at + 17], p[2] - words[at + 18]
    return (
        words[at + 7] * x + words[at + 10] * y + words[at + 13] * z,
        words[at + 8] * x + words[at + 11] * y + words[at + 14] * z,
        words[at + 9] * x + words[at + 12] * y + words[at + 15] * z,
    )


@lean_kernel
def end_of(work: Floats, i: int, side: int) -> Vec:
    """One end of capsule `i` in the base frame, that behind `side` 0 or 3."""
    return work[6 * i + side], work[6 * i + side + 1], work[6 * i + side + 2]


@lean_kernel
def radius_of(words: Floats, i: int) -> float:
    """Radius of capsule `i`."""
    return float(words[CAPSULES + CAPSULE_WORDS * i + 7])
