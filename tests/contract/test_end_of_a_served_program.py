"""A program in C that ends while one of its calls waits: all its arms begin to stop at the next sample."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import count
from typing import Final

import numpy as np
import pytest

from qrobot import rccl, rci
from qrobot.arcl import (
    MOV_TIME,
    ArclRobot,
    arcl_close,
    arcl_collision,
    arcl_open,
    arcl_setload,
    arcl_wait,
    joint_pos,
    new_sem,
    sem_pend,
)
from qrobot.arcl import move as arcl_move
from qrobot.arcl.program import end_all
from qrobot.arrays import Floats
from qrobot.c_transport.engine import ProgramGone
from qrobot.errors import MotionError
from qrobot.multi_rccl import Manip, jposition, move, rccl_control, rccl_open, rccl_release, setime, wait_for
from qrobot.multi_rccl.c.dispatcher import ManipDispatcher
from qrobot.multi_rccl.program import _program, this_program
from qrobot.rccl.jog import Stepper
from qrobot.rccl.offline import OfflineLink
from qrobot.rci.listening import listening
from qrobot.rci.program_time import program_time
from qrobot.wire import Command, Hello, State

PERIOD_NS: Final = 28_000_000
LATEST_NS: Final = 2 * PERIOD_NS  # the end is heard at one sample, and the setpoint behind it is another
GOAL_DEG: Final = [40.0, -50.0, 175.0, 30.0, 45.0, 20.0]
ARCL_GOAL_DEG: Final = [40.0, 60.0, -60.0, 30.0, 45.0, 20.0]
LONG_MS: Final = 4000.0
pytestmark = pytest.mark.usefixtures("arcl_alone")


class Served:
    """A program whose arms are ideal.

    Args:
        ends: it ends at the first sample behind `call`, else never.
    """

    def __init__(self, ends: bool) -> None:
        self.sent: list[dict[int, Floats]] = []
        self.called_ns = 0
        self._ends = ends
        self._begun_ns = program_time().now_ns

    @property
    def now_ns(self) -> int:
        """Time of the program."""
        return program_time().now_ns - self._begun_ns

    def link(self, hello: Hello) -> OfflineLink:
        """The way to the next arm."""
        served, sent = self, {}
        self.sent.append(sent)

        class Heard(OfflineLink):
            def exchange(self, command: Command | None) -> State:
                state = super().exchange(command)
                sent[served.now_ns] = np.array(state.robot.q_setpoint)
                return state

        return Heard(hello)

    def call(self) -> None:
        """The program is about to make the call that waits."""
        self.called_ns = self.now_ns

    def listen(self) -> None:
        """Raise when the program has ended."""
        if self._ends and 0 < self.called_ns < self.now_ns:
            raise ProgramGone


Program = Callable[[Served], object]
Call = Callable[[rccl.Channel], object]


@contextmanager
def served_by(served: Served, let_go: Callable[[], object]) -> Iterator[None]:
    """As the engine does it."""
    with rccl.use(served.link), rci.use(served.link):
        with suppress(ProgramGone, MotionError), listening(served.listen):
            yield
        let_go()


def of_an_arm(call: Call) -> Program:
    def program(served: Served) -> None:
        with served_by(served, rccl.release):
            arm = rccl.control()
            arm.setime(100.0, LONG_MS)
            goal = arm.jposition("GOAL", GOAL_DEG)
            arm.move(goal)
            arm.waitas(lambda: goal.scal > 0.1)
            served.call()
            call(arm)

    return program


def of_manipulators(call: Callable[[Manip, Manip], object], both: bool = True) -> Program:
    def program(served: Served) -> None:
        dispatcher = object.__new__(ManipDispatcher)
        token = _program.set(None)
        with served_by(served, dispatcher.let_go):
            arms = left, right = [rccl_open(name) for name in ("left", "right")]
            dispatcher._program = this_program()
            for arm in arms if both else arms[:1]:
                rccl_control(arm)
                setime(arm, 100.0, LONG_MS)
                move(arm, jposition(arm, "GOAL", GOAL_DEG))
                move(arm, jposition(arm, "NEXT", [0.0, *GOAL_DEG[1:]]))
            samples = count()
            left.channel.waitas(lambda: next(samples) > 40)
            served.call()
            call(left, right)
        _program.reset(token)

    return program


def of_robots(call: Callable[[ArclRobot, ArclRobot], object]) -> Program:
    def program(served: Served) -> None:
        with served_by(served, lambda: end_all(well=False)):
            robots = [arcl_open() for _ in range(2)]
            for rp in robots:
                arcl_move(rp, joint_pos(rp, "GOAL", ARCL_GOAL_DEG), MOV_TIME, LONG_MS)
                arcl_move(rp, joint_pos(rp, "NEXT", [0.0, *ARCL_GOAL_DEG[1:]]))
            samples = count()
            robots[0].wait(lambda: next(samples) > 40)
            served.call()
            call(*robots)

    return program


PROGRAMS: Final[dict[str, Program]] = {
    "sample": of_an_arm(lambda arm: arm.sample(20.0)),
    "a step": of_an_arm(lambda arm: Stepper(arm).obey("joint 1 -5")),
    "waitfor": of_an_arm(lambda arm: arm.waitfor(arm.completed)),
    "setload": of_an_arm(lambda arm: arm.setload(0.5)),
    "collision": of_an_arm(lambda arm: arm.collision("comply")),
    "rccl_control": of_manipulators(lambda _, right: rccl_control(right), both=False),
    "rccl_release": of_manipulators(lambda _, right: rccl_release(right)),
    "wait_for": of_manipulators(lambda left, _: wait_for(left.completed)),
    "arcl_open": of_robots(lambda *_: arcl_open()),
    "arcl_close": of_robots(lambda _, rp: arcl_close(rp)),
    "arcl_wait": of_robots(lambda rp, _: arcl_wait(rp)),
    "arcl_setload": of_robots(lambda rp, _: arcl_setload(rp, 0.5)),
    "arcl_collision": of_robots(lambda rp, _: arcl_collision(rp, "stop")),
    "sem_pend": of_robots(lambda *_: sem_pend(new_sem("never", value=False))),
}


def run(program: Program, ends: bool) -> Served:
    served = Served(ends)
    program(served)
    return served


@pytest.mark.sampled(5)
@pytest.mark.parametrize("call", PROGRAMS)
def test_all_arms_begin_to_stop_at_the_next_sample_when_the_program_ends_in_a_call_that_waits(call: str) -> None:
    ended, undisturbed = (run(PROGRAMS[call], ends) for ends in (True, False))
    under_way = [own for own in ended.sent if min(own) < ended.called_ns]
    assert under_way
    if call == "rccl_release":
        under_way.pop()  # which the call stops, whoever ends
    for own, whole in zip(under_way, undisturbed.sent, strict=False):
        left_ns = next((t for t, q in own.items() if not np.array_equal(q, whole.get(t))), None)
        assert left_ns is not None
        assert ended.called_ns < left_ns <= ended.called_ns + PERIOD_NS + LATEST_NS
        assert not np.ptp(list(own.values())[-2:], axis=0).any()


def test_a_semaphore_that_nobody_can_set_is_not_waited_for_without_a_robot() -> None:
    with listening(lambda: None), pytest.raises(MotionError, match="nothing is left that could set never"):
        sem_pend(new_sem("never", value=False))


def test_no_arm_is_taken_for_a_program_that_has_ended() -> None:
    """Nobody would be there to whom its power is of use."""
    ended, undisturbed = (run(PROGRAMS["rccl_control"], ends) for ends in (True, False))
    assert len(ended.sent[1]) < len(undisturbed.sent[1])
