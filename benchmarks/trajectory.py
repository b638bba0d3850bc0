"""Benchmark R: one setpoint of the motion engine, beside ruckig's (`pip install ruckig`), and the engine's whole cycle.

The compiled setpoint is the generator's sample in Cartesian mode without the interpreter (`benchmarks.tour`). ruckig,
in C++, is called from Python as its users do; it computes six joints and no kinematics. The cycle in Python is timed
with a functional transform in Python and an equation of eight terms, alone and under force control.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from time import perf_counter
from typing import Final

import numpy as np

from benchmarks.rows import Goal, Row, against, row
from benchmarks.timing import Effort, interleaved
from benchmarks.tour import CORNERS, PERIOD_S, Conveyor, Tour, bench_arm, planned_tour, scratch, walk, walk_again
from qrobot.arrays import Floats
from qrobot.model.arm import Arm
from qrobot.model.transform import transform
from qrobot.motion import (
    T6,
    ArmSample,
    Compliance,
    Drift,
    Duration,
    Equation,
    ForceControl,
    ForceLimits,
    Generator,
    MotionMode,
    MoveRequest,
    TransformKind,
    Trsf,
    motion_limits,
)

SETPOINTS: Final = 100_000
UPDATES: Final = 20_000
CYCLES: Final = 10_000
TURNS: Final = 4
CONVEYOR_M_S: Final = 0.01
SEGMENT_S: Final = 0.6


def rows(effort: Effort) -> Iterator[Row]:
    """The rows."""
    tour, q = planned_tour(effort.times(SETPOINTS))
    yield from setpoint_rows(tour, effort)
    yield from exactness_rows(tour, q)
    yield from cycle_rows(effort)


def setpoint_rows(tour: Tour, effort: Effort) -> Iterator[Row]:
    """Time for each setpoint."""
    updates, work_space, q = effort.times(UPDATES), scratch(), np.empty((tour.piece.size, 6))
    work: dict[str, Callable[[], object]] = {"setpoint": lambda: walk(tour, *work_space, q)}
    peer = ruckig_updates(*bench_arm()[::2])
    if peer is not None:
        work["ruckig"] = lambda: peer(updates)
    for each in work.values():
        each()  # compiles
    best = interleaved(work, TURNS * effort.rounds)
    us, name = 1e6 * best["setpoint"] / tour.piece.size, "Cartesian setpoint beside a conveyor, compiled"
    if peer is None:
        yield row(f"{name} (ruckig is not installed: `make bench` installs it)", us, "us", Goal(0.4))
    else:
        yield against(name, us, "us", "ruckig's update", 1e6 * best["ruckig"] / updates, Goal(0.4))


def exactness_rows(tour: Tour, q: Floats) -> Iterator[Row]:
    """How far compiled setpoints are from the generator's, and how many it would not have let out."""
    failed, again = walk_again(tour)
    yield row(
        "compiled setpoints, largest distance from the generator's", float(np.abs(again - q).max()), "rad", Goal(1e-12)
    )
    yield row("compiled setpoints beyond a limit", int(failed), "", Goal(0.0))


def cycle_rows(effort: Effort) -> Iterator[Row]:
    """The middle one of many cycles, s: planning comes in few of them."""
    cycles = effort.times(CYCLES)
    Round(comply=True).times_s(50)  # compiles
    plain, complying = (float(np.median(Round(comply).times_s(cycles))) for comply in (False, True))
    yield row(
        "the generator's cycle in Python, eight terms, Cartesian, functional transform", 1e6 * plain, "us", Goal(100.0)
    )
    yield row("the same with force control and limits of force", 1e6 * complying, "us", Goal(250.0))


class Round:
    """A generator that goes round four corners beside a conveyor.

    Args:
        comply: the arm gives way along the approach axis, and forces are limited.
    """

    def __init__(self, comply: bool) -> None:
        arm, kinematics, self._park = bench_arm()
        self._generator = Generator(motion_limits(arm.robot), PERIOD_S, self._park, kinematics=kinematics)
        self._force = ForceControl(arm.robot, PERIOD_S, kinematics) if comply else None
        self._drift, self._conveyor = Drift(), Conveyor(CONVEYOR_M_S * PERIOD_S)
        tool = transform(translation=[0.0, 0.0, 0.1])
        self._tool, self._base = (
            Trsf("TOOL", TransformKind.CONST, tool),
            Trsf("BASE", TransformKind.CONST, arm.forward(self._park) @ tool),
        )
        self._variable = [Trsf(name) for name in ("A", "B", "C")]
        self._asked = 0

    @property
    def yielding(self) -> int:
        """How many joints give way at the moment."""
        return 0 if self._force is None else len(self._force.joints)

    def times_s(self, cycles: int) -> Floats:
        """How long each cycle took. Shape (cycles,)."""
        times, q, tau = np.empty(cycles), self._park, np.zeros(self._park.size)
        for tick in range(1, cycles + 1):
            self._conveyor.tick = tick
            while self._generator.waiting < 2:
                self._generator.push(self._request())
            before, began = q, perf_counter()
            q = self._cycle(ArmSample(q, tau, tau, before), tick)
            times[tick - 1] = perf_counter() - began
        return times

    def _cycle(self, seen: ArmSample, tick: int) -> Floats:
        if self._force is None:
            return self._generator.update(tick).q
        self._force.observe(seen, self._generator, tick)
        q = self._generator.update(tick, self._force.standing).q
        self._force.command(q, seen, self._generator, tick)
        return q

    def _request(self) -> MoveRequest:
        """The next corner, by T6 TOOL = CONV BASE A B C CORNER."""
        x, y, _ = CORNERS[self._asked % len(CORNERS)]
        self._asked += 1
        corner = Trsf("CORNER", TransformKind.CONST, transform(translation=[x, y, 0.0]))
        right = [self._conveyor.trsf, self._base, *self._variable, corner]
        equation = Equation("CORNER", [T6, self._tool], right, self._tool)
        if self._force is None:
            return MoveRequest("corner", equation.goal(), Duration(SEGMENT_S), mode=MotionMode.CARTESIAN)
        compliance = Compliance(np.zeros(6), (2,), self._drift)
        limits = ForceLimits(np.full(6, 1e6), np.full(6, 1e3))
        goal = equation.goal(compliance=compliance)
        return MoveRequest("corner", goal, Duration(SEGMENT_S), mode=MotionMode.CARTESIAN, limits=limits)


def ruckig_updates(arm: Arm, park: Floats) -> Callable[[int], None] | None:
    """A function that makes ruckig give so many setpoints between two places; None when it is not installed."""
    try:
        from ruckig import InputParameter, OutputParameter, Result, Ruckig
    except ImportError:
        return None
    limits, n = arm.robot.limits, arm.robot.n
    online, wanted, given = Ruckig(n, PERIOD_S), InputParameter(n), OutputParameter(n)
    wanted.current_position = wanted.target_position = park.tolist()
    wanted.max_velocity, wanted.max_acceleration = limits.v_max.tolist(), limits.a_max.tolist()
    wanted.max_jerk = (50.0 * limits.a_max).tolist()
    places = [(park + 0.5).tolist(), park.tolist()]

    def updates(many: int) -> None:
        for _ in range(many):
            if online.update(wanted, given) == Result.Finished:
                places.reverse()
                wanted.target_position = places[0]
            given.pass_to_input(wanted)

    return updates
