"""What carries an arm of Multi-RCCL (frames, other arms, the program, itself), and how it comes to rest: ideal arms."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache, partial
from itertools import count
from typing import Final

import numpy as np
import pytest

from qrobot import rci
from qrobot.arrays import Floats
from qrobot.errors import LinkLost
from qrobot.model.transform import inverse, transform
from qrobot.multi_rccl import (
    EQ,
    TL,
    TRANS,
    Manip,
    RobotManip,
    comply,
    jposition,
    make_position,
    move,
    rccl_control,
    rccl_open,
    rccl_release,
    setime,
    setvel,
    tracking_mode,
    wait_as,
    wait_for,
)
from qrobot.multi_rccl.program import _program
from qrobot.rccl import Transform, gentr_rpy, gentr_trsl, newtrans, trsl
from qrobot.rccl.offline import OfflineLink
from qrobot.rccl.program import ending
from qrobot.wire import Command, Hello, JointMode, State

HERE = gentr_rpy("HERE", 500, 0, 0, 0, 170, 0)
THERE = gentr_rpy("THERE", 500, 60, 120, 0, 180, 0)
APART = gentr_trsl("APART", 0, -100, 0)
START: Final = np.radians([-20.0, -57.0, 205.0, 10.0, 22.0, -27.0])
"""Where all arms stand at first: a little way from HERE."""
ORDERS: Final = (("right", "left", "third"), ("third", "left", "right"))
"""In which arms are taken, and let go of at the end of the program."""
GOAL_DEG: Final = [40.0, -50.0, 175.0, 30.0, 45.0, 20.0]
LONG_MS: Final = 6000.0
CARRIED_MS: Final = 1500.0
UNDER_WAY: Final = 15  # samples from the beginning of all motions to the end of the program
AT_ONCE: Final = 40  # samples until an arm stands, or what it holds with others
ENDLESS: Final = 3000  # samples of one arm
CREEP: Final = 1e-4  # rad in a sample: of a joint that gives way


@dataclass
class Cell:
    """An object's frame and three arms: the hand of the left one and of the right one may hold it.

    Attributes:
        order: in which the arms are taken.
        breaks: the link of the third arm does, at its next sample.
        seen: the object, the left arm and the right one at each sample of that. Shapes (4, 4).
        sent: setpoints of each arm at each of its samples. Shape (n,).
        before: the number of them before the end.
        at_each_sample: called at each sample of the right arm.
    """

    order: tuple[str, ...]
    breaks: bool = False
    seen: list[tuple[Floats, Floats, Floats]] = field(default_factory=list)
    sent: dict[str, list[Floats]] = field(default_factory=dict)
    before: dict[str, int] = field(default_factory=dict)
    at_each_sample: Callable[[], object] = lambda: None

    def link(self, name: str, hello: Hello) -> OfflineLink:
        """The way to an arm whose joints creep along where they are to give way."""
        cell, sent = self, self.sent.setdefault(name, [])

        class Way(OfflineLink):
            def exchange(self, command: Command | None) -> State:
                if cell.breaks and name == "third":
                    raise LinkLost("the bridge of third has gone")
                state = super().exchange(None if command is None else giving_way(command, self._state.robot.q))
                sent.append(np.array(state.robot.q_setpoint))
                assert len(sent) < ENDLESS
                return state

        return Way(hello, start=START)

    def open(self) -> None:
        """Take the arms, and put the frame HERE."""
        self.obj = rccl_open("OBJECT_FRAME")
        rccl_control(self.obj)
        setime(self.obj, 200.0, 700.0)
        move(self.obj, make_position(TRANS, EQ, HERE, TL, TRANS))
        arms = {name: arm for name in self.order if isinstance(arm := rccl_open(name), RobotManip)}
        self.right, self.left, self.third = arms["right"], arms["left"], arms["third"]
        for arm in arms.values():
            rccl_control(arm)
        wait_for(self.obj.completed)
        self.right.channel.each_sample(self._look)

    def _look(self) -> None:
        self.at_each_sample()
        self.seen.append(tuple(each.trans.value.copy() for each in (self.obj, self.left, self.right)))  # type: ignore[arg-type]

    def pass_samples(self, samples: int) -> None:
        """Let time pass."""
        begun = self.left.sample
        wait_as(lambda: self.left.sample >= begun + samples)

    def carry(self) -> None:
        """Let the object go THERE."""
        setvel(self.obj, 100, 60)
        move(self.obj, make_position(TRANS, EQ, THERE, TL, TRANS))

    def begin(self, third: bool) -> None:
        """Let the third arm be on its way if it is to."""
        if third:
            setime(self.third, 100.0, LONG_MS)
            move(self.third, jposition(self.third, "FAR", GOAL_DEG))


def giving_way(command: Command, q: tuple[float, ...]) -> Command:
    """The same in positions: joints that are to exert torques creep along."""
    gives = [mode == JointMode.TORQUE for mode in command.modes]
    if not any(gives):
        return command
    setpoints = tuple(at + CREEP if give else to for give, at, to in zip(gives, q, command.setpoints, strict=True))
    return replace(command, modes=(JointMode.POSITION,) * len(gives), setpoints=setpoints)


def go_with(arm: Manip, *terms: Transform) -> None:
    """Let an arm come to a goal and stay with it."""
    tracking_mode(arm)
    move(arm, make_position(TRANS, EQ, *terms, TL, TRANS))
    wait_for(arm.completed)


def added() -> Transform:
    """A correction of the program's that is none."""
    return newtrans("ADDED", lambda t: trsl(t, 0, 0, 0))


def moved_on(step_mm: float) -> Callable[[Transform], object]:
    """Of a transform that goes on by a step at each look."""
    looks = count()
    return lambda t: t.set(HERE.value @ transform(translation=[0.0, 1e-3 * step_mm * next(looks), 0.0]))


# ------------------------------------------------------------------------------------- how the right arm is carried


def by_the_frame(cell: Cell) -> None:
    go_with(cell.left, cell.obj.trans)
    go_with(cell.right, cell.obj.trans, APART)
    cell.carry()


def by_the_frame_and_a_function(cell: Cell) -> None:
    go_with(cell.left, cell.obj.trans)
    go_with(cell.right, cell.obj.trans, APART, added())
    cell.carry()


def by_the_frame_and_a_variable(cell: Cell) -> None:
    go_with(cell.left, cell.obj.trans)
    go_with(cell.right, cell.obj.trans, APART, gentr_trsl("SHIFT", 0, 0, 0, "varb"))
    cell.carry()


def by_an_arm_that_the_frame_carries(cell: Cell) -> None:
    go_with(cell.left, cell.obj.trans)
    go_with(cell.right, cell.left.trans, APART)
    cell.carry()


def by_such_an_arm_and_a_function(cell: Cell) -> None:
    go_with(cell.left, cell.obj.trans)
    go_with(cell.right, cell.left.trans, APART, added())
    cell.carry()


WITH_THE_OBJECT: Final = (
    by_the_frame,
    by_the_frame_and_a_function,
    by_the_frame_and_a_variable,
)


def by_an_arm_on_its_path(cell: Cell) -> None:
    go_with(cell.left, HERE)
    go_with(cell.right, cell.left.trans, APART)
    setime(cell.left, 100.0, CARRIED_MS)
    move(cell.left, make_position(TRANS, EQ, THERE, TL, TRANS))


def by_an_arm_on_its_path_and_a_function(cell: Cell) -> None:
    go_with(cell.left, HERE)
    go_with(cell.right, cell.left.trans, APART, added())
    setime(cell.left, 100.0, CARRIED_MS)
    move(cell.left, make_position(TRANS, EQ, THERE, TL, TRANS))


WITH_AN_ARM: Final = (
    by_an_arm_that_the_frame_carries,
    by_such_an_arm_and_a_function,
    by_an_arm_on_its_path,
    by_an_arm_on_its_path_and_a_function,
)


def by_a_sensor(cell: Cell) -> None:
    go_with(cell.right, newtrans("SEEN", moved_on(1.0)))


def by_a_variable(cell: Cell) -> None:
    place, on = gentr_trsl("PLACE", 0, 0, 0, "varb"), moved_on(0.5)
    place.set(HERE.value)
    go_with(cell.right, place)
    cell.at_each_sample = lambda: on(place)


def by_forces(cell: Cell) -> None:
    comply(cell.right, "fz", 5.0)
    go_with(cell.right, HERE)


def by_the_frame_and_a_sensor(cell: Cell) -> None:
    looks = count()
    go_with(cell.right, cell.obj.trans, newtrans("SEEN", lambda t: trsl(t, 0, 0.5 * next(looks), 0)))


def by_the_frame_and_forces(cell: Cell) -> None:
    comply(cell.right, "fz", 5.0)
    go_with(cell.right, cell.obj.trans, APART)


def by_an_arm_that_a_sensor_carries(cell: Cell) -> None:
    go_with(cell.left, newtrans("SEEN", moved_on(0.5)))
    go_with(cell.right, cell.left.trans, APART)


def by_each_other(cell: Cell) -> None:
    go_with(cell.right, HERE)
    go_with(cell.left, cell.right.trans, gentr_trsl("ON", 0, 0.3, 0))
    go_with(cell.right, cell.left.trans)


BY_NOTHING_THAT_RESTS: Final = (
    by_a_sensor,
    by_a_variable,
    by_forces,
    by_the_frame_and_a_sensor,
    by_the_frame_and_forces,
    by_an_arm_that_a_sensor_carries,
    by_each_other,
)

# --------------------------------------------------------------------------------------------------- how that ends


def is_released(cell: Cell) -> None:
    rccl_release(cell.right)


def ends_well(cell: Cell) -> None:
    pass


def ends_badly(cell: Cell) -> None:
    raise ValueError


def loses_an_arm(cell: Cell) -> None:
    cell.breaks = True
    with suppress(LinkLost):
        wait_as(lambda: False)
    with suppress(LinkLost):
        rccl_release(cell.third)
    cell.pass_samples(2 * AT_ONCE)


Carried = Callable[[Cell], None]
End = Callable[[Cell], None]
ENDS: Final = (is_released, ends_well, ends_badly, loses_an_arm)
BAD_ENDS: Final = (ends_badly, loses_an_arm)


@cache
def run(carried: Carried, end: End, order: tuple[str, ...] = ORDERS[0], after: int = UNDER_WAY) -> tuple[Cell, int]:
    """A program, and the number of samples of the right arm before its end."""
    cell, begun = Cell(order), 0
    token = _program.set(None)
    try:
        with suppress(ValueError, LinkLost), rci.use({name: partial(cell.link, name) for name in order}), ending():
            cell.open()
            carried(cell)
            cell.begin(third=end in BAD_ENDS)
            cell.pass_samples(after)
            begun, cell.before = len(cell.seen), {name: len(own) for name, own in cell.sent.items()}
            end(cell)
    finally:
        _program.reset(token)
    return cell, begun


def standing_from(poses: Floats) -> int:
    """Number of the sample from which on all poses (k, ...) are the last one."""
    return int(np.flatnonzero(np.abs(np.diff(poses, axis=0)).reshape(len(poses) - 1, -1).max(axis=1)).max()) + 1


def off(cell: Cell, holder: int, since: int, until: int) -> float:
    """How far the right hand leaves its place on the object (0), or in the left hand (1), in these samples."""
    held = [inverse(each[holder]) @ each[2] for each in cell.seen[since:until]]
    return float(np.abs(np.array(held) - held[0]).max())


@pytest.mark.sampled(14)
@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("carried", [*WITH_THE_OBJECT, *WITH_AN_ARM])
def test_what_holds_something_with_others_stays_with_it_until_that_rests(carried: Carried, end: End) -> None:
    cell, begun = run(carried, end)
    holder = 0 if carried in WITH_THE_OBJECT else 1
    rests = standing_from(np.array([each[holder] for each in cell.seen]))
    assert rests > begun
    assert off(cell, holder, begun - 5, rests + 1) < 1e-9
    assert off(cell, holder, begun - 5, len(cell.seen)) < 1e-5
    assert end not in BAD_ENDS or rests - begun < AT_ONCE
    assert not np.ptp(cell.sent["right"][-2:], axis=0).any()


@pytest.mark.sampled(4)
@pytest.mark.parametrize("order", ORDERS, ids=" ".join)
@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("carried", BY_NOTHING_THAT_RESTS)
def test_what_nothing_that_rests_carries_comes_to_rest_by_a_stop_of_its_own(
    carried: Carried, end: End, order: tuple[str, ...]
) -> None:
    cell, begun = run(carried, end, order)
    path = np.array(cell.sent["right"][begun - len(cell.seen) - 4 :])
    assert np.abs(np.diff(path[:4], axis=0)).max() > 0.5 * CREEP  # it was under way
    assert standing_from(path) < AT_ONCE


@pytest.mark.sampled(4)
@pytest.mark.parametrize("order", ORDERS, ids=" ".join)
@pytest.mark.parametrize("carried", [by_a_sensor, by_a_variable, by_forces, by_each_other])
def test_what_nothing_that_rests_carries_begins_to_stop_with_the_others(
    carried: Carried, order: tuple[str, ...]
) -> None:
    cell, _ = run(carried, ends_badly, order)
    later, _ = run(carried, ends_badly, order, UNDER_WAY + 10)
    left_at = {
        name: next(k for k, q in enumerate(cell.sent[name]) if not np.array_equal(q, later.sent[name][k])) - before
        for name, before in cell.before.items()
        if name != "left"
    }
    assert left_at["right"] == left_at["third"]
