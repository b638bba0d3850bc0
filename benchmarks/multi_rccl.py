"""What a sample costs a program of one arm, of two, and of two that follow one object: generators, packets, ideal arms.

The arms stand face to face, a metre apart, and track a place that drifts: each by an equation with a functional
transform, or both by the frame of an object that is maintained there. Off line, so that no servo counts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from time import perf_counter_ns
from typing import Final, NamedTuple

import numpy as np

from benchmarks.rows import Row, against, row
from benchmarks.timing import Effort
from qrobot import rci
from qrobot.arrays import Floats
from qrobot.model.transform import inverse
from qrobot.multi_rccl import (
    EQ,
    TL,
    TRANS,
    RobotManip,
    maintain,
    make_position,
    move,
    rccl_control,
    rccl_open,
    rccl_release,
    tracking_mode,
    wait_as,
    wait_for,
)
from qrobot.rccl import gentr_rpy, gentr_trsl, newtrans, trsl
from qrobot.rccl.offline import OfflineLink
from qrobot.rccl.transforms import Transform

SAMPLES: Final = 3000
SETTLED: Final = 20  # samples that do not count
UPRIGHT: Final = gentr_rpy("UPRIGHT", 0, 0, 0, 0, 180, 0)
TOOL: Final = gentr_trsl("TOOL", 0, 0, 150)
WORLD: Final = {"left": gentr_trsl("LEFT", 0, 0, 0), "right": gentr_rpy("RIGHT", 1000, 0, 0, 180, 0, 0)}
GRIP: Final = {"left": gentr_trsl("GRIP1", 0, 100, 0), "right": gentr_trsl("GRIP2", 0, -100, 0)}


class Followed(NamedTuple):
    """What a run has given.

    Attributes:
        times_us: how long each sample took. Shape (samples,).
        off_m: of the hand that was farthest from its place in the end.
    """

    times_us: Floats
    off_m: float


def rows(effort: Effort) -> Iterator[Row]:
    """The rows: the best of several turns, of each the middle sample."""
    samples = effort.times(SAMPLES)
    kinds = {"one": (["left"], False), "two": (["left", "right"], False), "object": (["left", "right"], True)}
    best = dict.fromkeys(kinds, np.inf)
    for _ in range(effort.rounds):
        for kind, (sides, has_object) in kinds.items():
            best[kind] = min(best[kind], float(np.median(follow(sides, has_object, samples).times_us)))
    yield row("sample of one arm that tracks a place, off line", best["one"], "us")
    yield against("sample of two arms that track it", best["two"], "us", "one arm", best["one"])
    yield against("sample of two arms and the object that they follow", best["object"], "us", "one arm", best["one"])


def follow(sides: Sequence[str], has_object: bool, samples: int) -> Followed:
    """Let arms follow the place for so many samples, by an object's frame or by themselves."""
    seen = [0]

    def drift(t: Transform) -> None:
        seen[0] += 1
        trsl(t, 500.0 + 20.0 * np.sin(0.01 * seen[0]), 0.0, 20.0)

    with rci.use(dict.fromkeys(WORLD, OfflineLink)):
        place = newtrans("PLACE", drift)
        obj = rccl_open("OBJECT_FRAME") if has_object else None
        if obj is not None:
            rccl_control(obj)
            maintain(obj, make_position(TRANS, EQ, place, UPRIGHT, TL, TRANS))
        robots = [robot for side in sides if isinstance(robot := rccl_open(side), RobotManip)]
        held = [place, UPRIGHT] if obj is None else [obj.trans]
        for robot in robots:
            rccl_control(robot)
            tracking_mode(robot)
            move(robot, make_position(TRANS, TOOL, EQ, WORLD[robot.name], *held, GRIP[robot.name], TL, TOOL))
        for robot in robots:
            wait_for(robot.completed)
        times_us = sample_times(samples)
        at = np.linalg.multi_dot([np.eye(4), *(each.value for each in held)])
        off_m = max(off(robot, at) for robot in robots)
        for robot in robots:
            rccl_release(robot)
    return Followed(times_us, off_m)


def sample_times(samples: int) -> Floats:
    """How long so many samples take, us. Shape (samples,)."""
    instants: list[int] = []

    def look() -> bool:
        instants.append(perf_counter_ns())
        return len(instants) > samples + SETTLED

    wait_as(look)
    return np.diff(instants)[SETTLED:] / 1e3


def off(robot: RobotManip, at: Floats) -> float:
    """Distance of a hand from its place at what is at `at` in the world, m."""
    there = WORLD[robot.name].value @ at @ GRIP[robot.name].value
    return float(np.linalg.norm((inverse(there) @ robot.trans.value @ TOOL.value)[:3, 3]))
