"""What fences cost: the servo's look at them in each cycle, and the generator's at each sample and each motion.

Six capsules of the PUMA 560, four boxes, a cylinder and the arm itself; the peer is the same arm without fences.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from benchmarks.rows import Row, against, row
from benchmarks.servo import holding_rig, tracking
from benchmarks.timing import Effort, interleaved
from qrobot.config import load_robot
from qrobot.config.fences import Fence
from qrobot.fences.fence_set import FenceSet
from qrobot.model.arm import Arm
from qrobot.motion import Generator, JointSpeed, MoveRequest, kinematics_of, motion_limits

TICKS: Final = 100_000
POSES: Final = 20_000
MOTIONS: Final = 200
SAMPLES: Final = 40  # of a motion, before it ends
PERIOD_S: Final = 0.028
ROBOT: Final = load_robot("puma560")


def cell() -> FenceSet:
    """Four boxes at the corners, a cylinder to stay in, and the arm itself."""
    corners = [(x, y) for x in (-0.9, 0.9) for y in (-0.9, 0.9)]
    boxes = [
        Fence(name=f"box{k}", shape="box", size_m=(0.3, 0.3, 0.5), position_m=(x, y, -0.4), rpy_deg=(20.0, 0.0, 10.0))
        for k, (x, y) in enumerate(corners)
    ]
    room = Fence(name="room", shape="cylinder", keep="in", radius_m=1.2, length_m=3.0)
    return FenceSet(ROBOT, [*boxes, room], self_collision=True)


def rows(effort: Effort) -> Iterator[Row]:
    """The rows."""
    yield from tick_rows(effort)
    yield from motion_rows(effort)


def tick_rows(effort: Effort) -> Iterator[Row]:
    """Distances of one pose, and the tick of a servo that guards fences."""
    fences, many, poses = cell(), effort.times(TICKS), effort.times(POSES)
    park = ROBOT.poses["park"]
    fences.distances(park)
    runs = {"fenced": tracking(holding_rig(fences)), "free": tracking(holding_rig())}
    work: dict[str, Callable[[], object]] = {name: lambda run=run: run(many) for name, run in runs.items()}
    work["distances"] = lambda: [fences.distances(park) for _ in range(poses)]
    best = interleaved(work, effort.rounds)
    yield row("distances of an arm from six fences, from Python", best["distances"] / poses * 1e6, "us")
    name = "servo tick while tracking, inside six fences"
    yield against(name, best["fenced"] / many * 1e9, "ns", "without fences", best["free"] / many * 1e9)


def motion_rows(effort: Effort) -> Iterator[Row]:
    """A motion that is asked for, and the samples of it."""
    fences, many = cell(), effort.times(MOTIONS)
    push, samples = {}, {}
    for name, inside in (("fenced", fences), ("free", None)):
        push[name] = lambda inside=inside: [asked(inside) for _ in range(many)]
    for name, inside in (("fenced", fences), ("free", None)):
        samples[name] = lambda inside=inside: [sampled(inside) for _ in range(many)]
    for each in (*push.values(), *samples.values()):
        each()  # compiles
    begun, done = interleaved(push, effort.rounds), interleaved(samples, effort.rounds)
    peer = "without fences"
    ms = {name: seconds / many * 1e3 for name, seconds in begun.items()}
    yield against("a joint motion asked for, inside six fences", ms["fenced"], "ms", peer, ms["free"])
    us = {name: (done[name] - begun[name]) / many / SAMPLES * 1e6 for name in begun}
    yield against("the generator's sample of 28 ms, inside six fences", us["fenced"], "us", peer, us["free"])


def asked(fences: FenceSet | None) -> Generator:
    """A generator with one motion that waits to begin."""
    park = ROBOT.poses["park"]
    motion = Generator(
        motion_limits(ROBOT), PERIOD_S, np.array(park), kinematics=kinematics_of(Arm(ROBOT)), fences=fences
    )
    motion.push(MoveRequest("goal", park + np.array([0.8, 0.3, -0.3, 0.4, 0.2, 0.5]), JointSpeed(0.5)))
    return motion


def sampled(fences: FenceSet | None) -> None:
    """The same, and some of its samples."""
    motion = asked(fences)
    for tick in range(1, SAMPLES + 1):
        motion.update(tick)
