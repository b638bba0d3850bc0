"""Signed distances of a capsule from a plane, a box, a cylinder and another capsule, as kernels, in m.

The signed distance of a point from a convex body, d(p), is below zero inside and a convex function of p. On the axis of
a capsule, p(t) = a + t (b - a), it is therefore convex in t, so that golden sections find its least value, and its
greatest one is at an end of the axis. From these two numbers, with the radius r of the capsule,

    keep out of the body:   min over t of d(p(t)) - r
    stay inside the body:   -max(d(a), d(b)) - r

Two capsules are as far apart as their axes, less both radii (Ericson, Real-Time Collision Detection, 2005, 5.1.9).
"""

from __future__ import annotations

import math
from typing import Final

from qrobot.model.vec3 import Vec, add, dot, scale
from qrobot.realtime.jit import lean_kernel

PLANE, BOX, CYLINDER = 0, 1, 2
FINE_M: Final = 1e-5  # [A] of the axis, to which its nearest point is found
GOLDEN: Final = 0.5 * (math.sqrt(5.0) - 1.0)
POINT_M2: Final = 1e-18  # square of the length of an axis that is a point


@lean_kernel
def outside(kind: int, half: Vec, p: Vec) -> float:
    """Signed distance of the point `p` from a body about the origin.

    Args:
        kind: PLANE: all that lies below z = 0; BOX; CYLINDER about z.
        half: half the edges of a box; radius, nothing, and half the length of a cylinder.
        p: the point, in the frame of the body.
    """
    if kind == PLANE:
        return p[2]
    if kind == BOX:
        x, y, z = abs(p[0]) - half[0], abs(p[1]) - half[1], abs(p[2]) - half[2]
    else:
        x, y, z = math.sqrt(p[0] * p[0] + p[1] * p[1]) - half[0], -half[0], abs(p[2]) - half[2]
    u, v, w = max(x, 0.0), max(y, 0.0), max(z, 0.0)
    inside = max(x, z) if kind == CYLINDER else max(x, y, z)
    return math.sqrt(u * u + v * v + w * w) + min(inside, 0.0)


@lean_kernel
def along(a: Vec, b: Vec, t: float) -> Vec:
    """The point at share `t` of the way from `a` to `b`."""
    return a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2])


@lean_kernel
def length_of(a: Vec, b: Vec) -> float:
    """Distance of two points."""
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    return math.sqrt(x * x + y * y + z * z)


@lean_kernel
def axis_outside(kind: int, half: Vec, a: Vec, b: Vec, enough: float) -> float:
    """The least signed distance of the points from `a` to `b`, to `FINE_M`; any bound of it from `enough` on."""
    length = length_of(a, b)
    if kind == PLANE or length <= FINE_M:
        return min(outside(kind, half, a), outside(kind, half, b))
    bound = outside(kind, half, along(a, b, 0.5)) - 0.5 * length
    if bound >= enough:  # the distance changes no faster than the point moves
        return bound
    low, high = 0.0, 1.0
    t, s = 1.0 - GOLDEN, GOLDEN
    at_t, at_s = outside(kind, half, along(a, b, t)), outside(kind, half, along(a, b, s))
    least = min(outside(kind, half, a), outside(kind, half, b))
    while (high - low) * length > FINE_M:
        if at_t <= at_s:
            high, s, at_s = s, t, at_t
            t = high - GOLDEN * (high - low)
            at_t = outside(kind, half, along(a, b, t))
        else:
            low, t, at_t = t, s, at_s
            s = low + GOLDEN * (high - low)
            at_s = outside(kind, half, along(a, b, s))
    return min(least, at_t, at_s)


@lean_kernel
def axis_inside(kind: int, half: Vec, a: Vec, b: Vec) -> float:
    """Least depth inside of the points from `a` to `b`; below zero when one of them is outside."""
    return -max(outside(kind, half, a), outside(kind, half, b))


@lean_kernel
def axes_apart(a: Vec, b: Vec, c: Vec, d: Vec) -> float:
    """Least distance of the points from `a` to `b` from those from `c` to `d`."""
    u, v, r = add(b, scale(-1.0, a)), add(d, scale(-1.0, c)), add(a, scale(-1.0, c))
    uu, vv, vr, ur, uv = dot(u, u), dot(v, v), dot(v, r), dot(u, r), dot(u, v)
    s, t = 0.0, 0.0
    if uu <= POINT_M2 and vv > POINT_M2:
        t = between(vr / vv)
    elif uu > POINT_M2 and vv <= POINT_M2:
        s = between(-ur / uu)
    elif uu > POINT_M2:
        crossing = uu * vv - uv * uv
        s = between((uv * vr - ur * vv) / crossing) if crossing > 1e-12 * uu * vv else 0.0
        t = (uv * s + vr) / vv
        if t < 0.0:
            t, s = 0.0, between(-ur / uu)
        elif t > 1.0:
            t, s = 1.0, between((uv - ur) / uu)
    return length_of(along(a, b, s), along(c, d, t))


@lean_kernel
def between(share: float) -> float:
    """A share, from 0 to 1."""
    return min(max(share, 0.0), 1.0)
