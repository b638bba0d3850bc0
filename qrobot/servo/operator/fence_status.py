"""Fences for the control interface: those that a servo guards, and how far from each the arm is."""

from __future__ import annotations

from qrobot.arrays import Floats
from qrobot.fences.fence_set import FenceSet, Nearness
from qrobot.servo.operator.messages import FenceStatus


def fence_status(fences: FenceSet | None, q: Floats) -> tuple[FenceStatus, ...]:
    """Each fence and the arm at `q` (n,); none for an arm without fences."""
    if fences is None:
        return ()
    shapes = {fence.name: (fence.shape, fence.keep, fence.bodies) for fence in fences.fences}
    return tuple(
        _told(near, *shapes.get(near.fence, ("capsules", "out", "all"))) for near in fences.for_one_thread().nearness(q)
    )


def _told(near: Nearness, shape: str, keep: str, bodies: str) -> FenceStatus:
    return FenceStatus(
        name=near.fence,
        shape=shape,
        keep=keep,
        bodies=bodies,
        body=near.body,
        distance_m=near.distance,
        margin_m=near.margin,
    )
