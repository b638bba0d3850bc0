"""When a program of several arms ends badly all begin to stop at one sample, though they are let go of in turn."""

from __future__ import annotations

import atexit
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from contextvars import copy_context
from functools import cache
from itertools import count
from threading import Thread
from typing import Final

import numpy as np
import pytest

from qrobot import rccl, rci
from qrobot.arcl import MOV_TIME, arcl_open, joint_pos
from qrobot.arcl import move as arcl_move
from qrobot.arrays import Floats
from qrobot.cli.run import _arcl_ending
from qrobot.errors import letting_go
from qrobot.motion import Termination
from qrobot.multi_rccl import (
    EQ,
    TL,
    TRANS,
    Manip,
    jposition,
    make_position,
    move,
    rccl_control,
    rccl_open,
    rccl_release,
    setime,
    tracking_mode,
    wait_as,
    wait_for,
)
from qrobot.multi_rccl.c.dispatcher import ManipDispatcher
from qrobot.multi_rccl.program import _program, this_program
from qrobot.rccl import Position, gentr_rpy, newtrans, trsl
from qrobot.rccl.offline import OfflineLink
from qrobot.rccl.program import ending
from qrobot.rci import TaskDescriptor, bad_end
from qrobot.rci.program_time import program_time
from qrobot.units import NS_PER_S
from qrobot.wire import Command, Hello, State

ARMS: Final = ("left", "middle", "right")
GOAL_DEG: Final = [40.0, -50.0, 175.0, 30.0, 45.0, 20.0]
ARCL_GOAL_DEG: Final = [40.0, 60.0, -60.0, 30.0, 45.0, 20.0]
LONG_MS: Final = 3000.0
TURN: Final = 1e-3  # rad in each sample
ENDS_S: Final = 1.0  # from the beginning: all arms are on their way
AT_ONCE: Final = 40  # samples, until the arm rests and is let go of


class Ways:
    """Links to ideal arms; what each was sent at which instant of the program, and whose links were closed.

    Args:
        interrupt_s: time from the beginning at which Ctrl-C comes, None for never.
    """

    def __init__(self, interrupt_s: float | None = None) -> None:
        self.sent: Sent = {}
        self.closed: list[str] = []
        self._numbers = count()
        self._begun_ns = program_time().now_ns
        self._interrupt_s = interrupt_s

    def link(self, hello: Hello) -> OfflineLink:
        """The way to the next arm."""
        ways, name = self, ARMS[next(self._numbers)]
        sent = self.sent.setdefault(name, {})

        class Heard(OfflineLink):
            def exchange(self, command: Command | None) -> State:
                state = super().exchange(command)
                sent[program_time().now_ns - ways._begun_ns] = np.array(state.robot.q_setpoint)
                ways._interrupt()
                return state

            def close(self, reason: str = "") -> None:
                ways.closed.append(name)
                super().close(reason)

        return Heard(hello)

    @property
    def on_their_way(self) -> bool:
        """All arms move."""
        return program_time().now_ns - self._begun_ns >= ENDS_S * NS_PER_S

    def _interrupt(self) -> None:
        if self._interrupt_s is not None and program_time().now_ns - self._begun_ns >= self._interrupt_s * NS_PER_S:
            self._interrupt_s = None
            signal.raise_signal(signal.SIGINT)


def start(arm: rccl.Channel) -> rccl.Channel:
    """An arm that begins a long motion."""
    arm.setime(100.0, LONG_MS)
    arm.move(arm.jposition("GOAL", GOAL_DEG))
    return arm


Sent = dict[str, dict[int, Floats]]
End = Callable[[], object]
Program = Callable[[Ways, End], None]
"""A program whose arms are on their way when it calls `end`, and ends."""


def by_channels(ways: Ways, end: End) -> None:
    with rccl.use(ways.link), ending():
        arms = [start(rccl.control()) for _ in ARMS]
        arms[0].waitas(lambda: ways.on_their_way)
        end()


def by_blocks(ways: Ways, end: End) -> None:
    with rccl.use(ways.link), ExitStack() as blocks:
        arms = [start(blocks.enter_context(rccl.control())) for _ in ARMS]
        arms[0].waitas(lambda: ways.on_their_way)
        end()


def by_manipulators(ways: Ways, end: End) -> None:
    token = _program.set(None)
    try:
        with rci.use(ways.link), ending():
            for name in ARMS:
                arm = rccl_open(name)
                rccl_control(arm)
                setime(arm, 100.0, LONG_MS)
                move(arm, jposition(arm, "GOAL", GOAL_DEG))
            wait_as(lambda: ways.on_their_way)
            end()
    finally:
        _program.reset(token)


def by_manipulators_in_c(ways: Ways, end: End) -> None:
    """The program's own part is the test's; what lets go of its arms is that of a program in C."""
    served = object.__new__(ManipDispatcher)
    token = _program.set(None)
    try:
        with rci.use(ways.link):
            for name in ARMS:
                rccl_control(arm := rccl_open(name))
                setime(arm, 100.0, LONG_MS)
                move(arm, jposition(arm, "GOAL", GOAL_DEG))
            served._program = this_program()
            with letting_go(served.let_go):
                wait_as(lambda: ways.on_their_way)
                end()
    finally:
        _program.reset(token)


def by_robots(ways: Ways, end: End) -> None:
    with rci.use(ways.link), _arcl_ending():
        robots = [arcl_open() for _ in ARMS]
        for rp in robots:
            arcl_move(rp, joint_pos(rp, "GOAL", ARCL_GOAL_DEG), MOV_TIME, LONG_MS)
            arcl_move(rp, joint_pos(rp, "NEXT", [0.0, *ARCL_GOAL_DEG[1:]]))
        robots[0].wait(lambda: ways.on_their_way)
        end()


def by_libraries(ways: Ways, end: End) -> None:
    with rccl.use(ways.link), rci.use(ways.link), ending(), _arcl_ending():
        arm, rp = rccl.control(), arcl_open()
        arcl_move(rp, joint_pos(rp, "GOAL", ARCL_GOAL_DEG), MOV_TIME, LONG_MS)
        start(arm).waitas(lambda: ways.on_their_way)
        end()


def turn(td: TaskDescriptor) -> None:
    """A control function that moves on for ever."""
    first, *others = td.how.q_setpoint
    td.chg.go_to((first + TURN, *others))


def start_task() -> None:
    """An arm that a control function of RCI moves."""
    td = rci.rci_create("puma560")
    rci.rci_control(td, turn)
    rci.rci_start(td.bit)


def channel_and_task(ways: Ways, end: End) -> None:
    arm = start(rccl.control())
    start_task()
    arm.waitas(lambda: ways.on_their_way)
    end()


def task_and_channel(ways: Ways, end: End) -> None:
    start_task()
    start(rccl.control()).waitas(lambda: ways.on_their_way)
    end()


def by_channel_and_task(ways: Ways, end: End) -> None:
    with rccl.use(ways.link), rci.use(ways.link), closing_rci(), ending():
        channel_and_task(ways, end)


def by_task_and_channel(ways: Ways, end: End) -> None:
    with rccl.use(ways.link), rci.use(ways.link), closing_rci(), ending():
        task_and_channel(ways, end)


def by_robot_and_task(ways: Ways, end: End) -> None:
    with rci.use(ways.link), closing_rci(), _arcl_ending():
        rp = arcl_open()
        arcl_move(rp, joint_pos(rp, "GOAL", ARCL_GOAL_DEG), MOV_TIME, LONG_MS)
        start_task()
        rp.wait(lambda: ways.on_their_way)
        end()


@contextmanager
def closing_rci() -> Iterator[None]:
    """As the interpreter does it in the end."""
    try:
        yield
    finally:
        rci.rci_close()


WITH_TASKS: Final = (by_channel_and_task, by_task_and_channel, by_robot_and_task)
PROGRAMS: Final = (by_channels, by_blocks, by_manipulators, by_robots, by_libraries, *WITH_TASKS)
pytestmark = pytest.mark.usefixtures("arcl_alone")


def sent_by(
    program: Program, end: End = lambda: None, interrupt_s: float | None = None
) -> dict[str, dict[int, Floats]]:
    ways = Ways(interrupt_s)
    with suppress(ValueError, KeyboardInterrupt, SystemExit):
        program(ways, end)
    return ways.sent


@cache
def left_alone(program: Program) -> Sent:
    """What a program sends that comes to its end, which is the same each time."""
    return sent_by(program)


def raising(error: BaseException) -> End:
    def end() -> None:
        raise error

    return end


def assert_all_stop_at_one_sample(
    sent: dict[str, dict[int, Floats]], undisturbed: dict[str, dict[int, Floats]]
) -> None:
    left = {
        next((t for t, q in own.items() if not np.array_equal(q, undisturbed[name].get(t))), None)
        for name, own in sent.items()
    }
    assert None not in left
    assert len(left) == 1
    assert all(not np.ptp(list(own.values())[-2:], axis=0).any() for own in sent.values())  # and come to rest


@pytest.mark.sampled(4)
@pytest.mark.parametrize("error", [ValueError(), KeyboardInterrupt(), SystemExit(1)], ids=lambda e: type(e).__name__)
@pytest.mark.parametrize("program", PROGRAMS)
def test_all_arms_of_a_program_that_ends_badly_begin_to_stop_at_one_sample(
    program: Program, error: BaseException
) -> None:
    assert_all_stop_at_one_sample(sent_by(program, raising(error)), left_alone(program))


@pytest.mark.parametrize("program", PROGRAMS)
def test_a_program_that_exits_with_status_0_has_all_its_motions_done(program: Program) -> None:
    sent, undisturbed = sent_by(program, raising(SystemExit(0))), left_alone(program)
    assert {name: list(own) for name, own in sent.items()} == {name: list(own) for name, own in undisturbed.items()}
    assert all(np.array_equal(q, undisturbed[name][t]) for name, own in sent.items() for t, q in own.items())


@pytest.mark.parametrize("program", PROGRAMS)
def test_ctrl_c_while_the_last_motions_of_a_program_are_done_stops_all_its_arms(program: Program) -> None:
    assert_all_stop_at_one_sample(sent_by(program, interrupt_s=ENDS_S + 1.0), left_alone(program))


@pytest.mark.parametrize(
    ("begun", "undisturbed"), [(channel_and_task, by_channel_and_task), (task_and_channel, by_task_and_channel)]
)
def test_a_channel_and_a_task_begin_to_stop_at_one_sample_when_plain_python_ends_badly(
    begun: Program, undisturbed: Program, monkeypatch: pytest.MonkeyPatch
) -> None:
    at_exit: list[Callable[[], object]] = []
    expected = left_alone(undisturbed)
    ways = Ways()
    monkeypatch.setattr("qrobot.rci.calls._program", None)
    monkeypatch.setattr("qrobot.rci.calls._shared", None)
    monkeypatch.setattr(atexit, "register", at_exit.append)
    monkeypatch.setattr(sys, "last_value", ValueError(), raising=False)
    with rccl.use(ways.link), rci.use(ways.link):
        begun(ways, lambda: None)
        for function in reversed(at_exit):
            function()
    assert len(at_exit) == 2
    assert_all_stop_at_one_sample(ways.sent, expected)


@pytest.mark.sampled(14)
@pytest.mark.parametrize("nth", [1, 2, 3])
@pytest.mark.parametrize("program", [*PROGRAMS, by_manipulators_in_c])
def test_ctrl_c_while_all_are_told_to_stop_keeps_none_from_its_rest_and_its_goodbye(
    program: Program, nth: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls, ways = count(1), Ways()

    def interrupted() -> None:
        if next(calls) == nth:
            raise KeyboardInterrupt

    monkeypatch.setattr(bad_end, "_stops", [interrupted, *bad_end._stops])
    with suppress(ValueError, KeyboardInterrupt):
        program(ways, raising(ValueError()))
    assert set(ways.closed) == set(ways.sent)
    assert all(not np.ptp(list(own.values())[-2:], axis=0).any() for own in ways.sent.values())
    assert all(list(own)[-1] < (ENDS_S + 1.5) * NS_PER_S for own in ways.sent.values())


def test_an_error_that_is_handled_inside_the_block_of_an_arm_stops_no_other() -> None:
    with rccl.use(Ways().link), rccl.control() as left:
        goal = left.jposition("GOAL", GOAL_DEG)
        left.move(goal)
        with rccl.control() as right, suppress(ValueError):
            start(right)
            raise ValueError
    assert goal.code == Termination.COMPLETED


def test_an_error_stops_no_arm_in_the_block_of_another_thread() -> None:
    arms: list[rccl.Channel] = []
    with rccl.use(Ways().link):
        surroundings = copy_context()
        thread = Thread(target=surroundings.run, args=(lambda: arms.append(start(rccl.control().__enter__())),))
        thread.start()
        thread.join()
        with suppress(ValueError), rccl.control():
            raise ValueError
        assert arms[0].unserved == 1
        arms[0].release()


def sensed() -> Position:
    """A place that goes on by a millimetre at each sample."""
    looks = count()
    seen = newtrans("SEEN", lambda t: trsl(t, 500, 1.0 * next(looks), 0))
    return make_position(TRANS, EQ, seen, gentr_rpy("TURNED", 0, 0, 0, 0, 180, 0), TL, TRANS)


@pytest.mark.parametrize("end", [rccl_release, lambda _: raising(ValueError())()], ids=["release", "error"])
def test_an_arm_that_follows_a_sensor_stops_at_once(end: Callable[[Manip], object]) -> None:
    ways = Ways()
    token = _program.set(None)
    with suppress(ValueError), rci.use(ways.link), ending():
        arm = rccl_open("left")
        rccl_control(arm)
        tracking_mode(arm)
        move(arm, sensed())
        wait_for(arm.completed)
        begun_ns = list(ways.sent["left"])[-1]
        end(arm)
    _program.reset(token)
    path = np.array([q for t, q in ways.sent["left"].items() if t >= begun_ns])
    assert np.abs(np.diff(path[:2], axis=0)).max() > 1e-3  # it was under way
    assert len(path) < AT_ONCE
