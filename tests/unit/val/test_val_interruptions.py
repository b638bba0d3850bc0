"""Ctrl-C at any line of the interpreter: no step is lost, none is done twice, and the arm stands."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from inspect import getfile
from pathlib import Path
from typing import Any

import pytest

from qrobot.errors import LinkError
from qrobot.rci.interruption import WholeSamples
from qrobot.realtime.signals import handled
from qrobot.val.interpreter import Interpreter, RunState
from qrobot.val.monitor import ValMonitor
from qrobot.val.source import read_source
from tests.support.fake_robot import FakeRobot
from tests.support.puma import PARK
from tests.support.signals import ctrl_c_at
from tests.support.thorough import examples
from tests.support.val_runs import PLACES, faked_arm, interpreter, interrupt_at, main_program, number

OF_THE_INTERPRETER = str(Path(getfile(Interpreter)).parent), getfile(WholeSamples)
MEETINGS = examples(150)  # lines that are tried
COUNTING = (
    "RUNSIG 3",
    "FOR i = 1 TO 3",
    "n = n+1",
    "CALL double(n, m)",
    "SIGNAL 1",
    "SIGNAL -1",
    'TYPE "n", n',
    "END",
    "MOVE a",
    "n = n+1",
    "BREAK",
    "k = SIG(3)",
)
DOUBLE = ".PROGRAM double(x, y)\ny = y+2*x\n.END\n.REALS\nn 0\nm 0\n.END\n"
RETRIES = 10


@contextmanager
def _ctrl_c_at(event: int) -> Iterator[list[int]]:
    """Ctrl-C at the line of the interpreter's own code of this number, counted from here; gives how many there were."""
    with handled({signal.SIGINT: signal.default_int_handler}), ctrl_c_at(event, OF_THE_INTERPRETER) as seen:
        yield seen


def _finish(run: Interpreter) -> None:
    """Go on after Ctrl-C, as somebody at the monitor would."""
    for _ in range(RETRIES):
        if run.state is RunState.COMPLETED:
            return
        run.execute("main") if run.state is RunState.IDLE else run.proceed()
    raise AssertionError(f"it does not end: {run.state}")


@contextmanager
def _begun(begin: str) -> Iterator[tuple[Interpreter, list[str]]]:
    """A program that is to be executed, or gone on with after Ctrl-C in its first motion, of which most is left."""
    with interpreter(main_program("MOVE b", "BREAK", *COUNTING, rest=DOUBLE + PLACES)) as (run, typed):
        if begin == "proceed":
            interrupt_at(run, 8)
            with pytest.raises(KeyboardInterrupt):
                run.execute("main")
        yield run, typed


def _go(run: Interpreter, begin: str) -> None:
    run.execute("main") if begin == "execute" else run.proceed()


def _lines_of_a_run(begin: str) -> int:
    with _begun(begin) as (run, _), _ctrl_c_at(-1) as seen:
        _go(run, begin)
        return seen[0]


def _recorded_signals(run: Interpreter) -> list[int]:
    """Outputs that are switched from now on, negative for off."""
    switched: list[int] = []
    switch = run.machine.arm.signal

    def record(*lines: int) -> None:
        switched.extend(lines)
        switch(*lines)

    run.machine.arm.signal = record  # type: ignore[method-assign]
    return switched


@pytest.mark.parametrize("begin", ["execute", "proceed"])
def test_ctrl_c_at_any_line_loses_no_step_and_does_none_twice(begin: str) -> None:
    lines = _lines_of_a_run(begin)
    assert lines > 2 * MEETINGS
    for event in range(1, int(0.9 * lines), lines // MEETINGS):  # the first run takes some more
        with _begun(begin) as (run, typed):
            switched = _recorded_signals(run)
            with pytest.raises(KeyboardInterrupt), _ctrl_c_at(event):
                _go(run, begin)
            assert not run.machine.arm._moves(), event
            assert switched.count(-3) >= switched.count(3)  # RUNSIG's is off while nothing runs
            _finish(run)
            assert [number(run, name) for name in ("n", "m", "k")] == [4.0, 12.0, -1.0], event
            assert [line for line in switched if abs(line) == 1] == [1, -1] * 3, event
            assert len(set(typed)) == 3
            assert run.machine.arm.outputs == 0
            assert run.machine.arm.idle


def test_ctrl_c_while_a_line_is_typed_comes_into_force_at_once_and_types_it_again() -> None:
    """A terminal that takes nothing, as a full pipe, keeps no arm moving."""
    with interpreter(main_program("MOVE a", 'TYPE "here"', "x = 1", rest=PLACES)) as (run, typed):
        say = run.machine.say
        waits = iter([True])

        def wait(text: str) -> None:
            if next(waits, False):
                signal.raise_signal(signal.SIGINT)
                raise AssertionError("the terminal would have waited for ever")
            say(text)

        run.machine.say = wait
        with pytest.raises(KeyboardInterrupt):
            run.execute("main")
        assert run.state is RunState.PAUSED
        assert run.machine.arm.idle
        assert run.proceed() is RunState.COMPLETED, run.message
        assert typed == ["here"]
        assert number(run, "x") == 1.0


def test_a_second_ctrl_c_does_not_wait_for_a_step_that_hangs() -> None:
    with interpreter(main_program("SIGNAL 1", "x = 1")) as (run, _):
        heard = []

        def hang(*_lines: int) -> None:
            signal.raise_signal(signal.SIGINT)
            heard.append("the first one is held back")
            signal.raise_signal(signal.SIGINT)
            raise AssertionError("it would have waited for ever")

        run.machine.arm.signal = hang  # type: ignore[method-assign]
        with pytest.raises(KeyboardInterrupt):
            run.execute("main")
        assert heard == ["the first one is held back"]
        assert run.state is RunState.PAUSED


@pytest.mark.parametrize("library", ["rccl", "arcl"])
def test_two_at_one_sample_let_go_of_the_arm_which_the_next_commands_tell(library: str) -> None:
    class Robot(FakeRobot):
        hit = False

        def transfer(self, data: bytes) -> bytes:
            if self.hit:
                self.hit = False
                signal.raise_signal(signal.SIGINT)
                signal.raise_signal(signal.SIGINT)
            return super().transfer(data)

    robot = Robot(tuple(PARK))
    with faked_arm(robot, library) as arm:
        run = Interpreter(arm, [].append, str)
        run.machine.load(read_source(main_program("x = 1", "MOVE a", rest=PLACES))[0])
        _once(run, "x", partial(setattr, robot, "hit", True))
        with pytest.raises(KeyboardInterrupt):
            run.execute("main")
        for _ in range(2):
            with pytest.raises(LinkError, match="an interrupt in the midst of a sample has let go of the arm"):
                run.execute("main")


def test_an_error_in_the_turn_of_a_ctrl_c_is_told_and_can_be_retried() -> None:
    with interpreter(main_program("x = 1", "x = 1/y")) as (run, _):
        run.machine.values["y", ()] = 0.0
        _ctrl_c_as_soon_as(run, "x")
        with pytest.raises(KeyboardInterrupt):
            run.execute("main")
        assert number(run, "x") == 1.0
        assert run.state is RunState.FAILED
        assert "line 3" in run.message
        run.machine.values["y", ()] = 4.0
        assert run.retry() is RunState.COMPLETED
        assert number(run, "x") == 0.25


def _ctrl_c_as_soon_as(run: Interpreter, name: str) -> None:
    """Hit Ctrl-C when a variable gets its first value."""
    _once(run, name, partial(signal.raise_signal, signal.SIGINT))


def _once(run: Interpreter, name: str, do: Callable[[], object]) -> None:
    """Do something when a variable gets its first value."""

    class Values(dict[Any, Any]):
        def __setitem__(self, key: Any, value: Any) -> None:
            first = key not in self
            super().__setitem__(key, value)
            if first and key == (name, ()):
                do()

    run.machine.values = Values(run.machine.values)


@pytest.mark.parametrize("step", ["PAYLOAD 2", "PARAMETER COLLISION = 60", "ENABLE COMPLY"])
def test_ctrl_c_while_a_step_waits_for_the_servo_comes_into_force_at_once(step: str) -> None:
    with interpreter(main_program("MOVE a", step, "x = 1", rest=PLACES)) as (run, _):
        arm, waits = run.machine.arm, iter([True])
        told: list[object] = []

        def tell(*what: object) -> None:
            if next(waits, False):
                signal.raise_signal(signal.SIGINT)
                raise AssertionError("it would have waited while the arm moves")
            told.append(what)

        arm.payload = arm.collision = tell  # type: ignore[method-assign]
        with pytest.raises(KeyboardInterrupt):
            run.execute("main")
        assert run.state is RunState.PAUSED
        assert arm.idle
        assert run.proceed() is RunState.COMPLETED, run.message
        assert len(told) == 1
        assert number(run, "x") == 1.0


def test_what_the_monitor_says_of_a_command_that_ctrl_c_has_ended() -> None:
    with interpreter(main_program("MOVE a", "x = 1", "x = 1/y", rest=PLACES)) as (run, _):
        monitor = ValMonitor(run)
        run.machine.values["y", ()] = 0.0
        _ctrl_c_as_soon_as(run, "x")
        assert monitor.obey("EXECUTE main") == (
            "interrupted: the arm stands; PROCEED goes on\n"
            "stopped by an error: program main, line 4, column 6: 1 / 0 is no number"
        )
        _ctrl_c_as_soon_as(run, "z")
        assert monitor.obey("DO z = 1") == "interrupted: the arm stands; PROCEED goes on"  # the error was told already
        _ctrl_c_as_soon_as(run, "w")
        assert monitor.obey("ABORT") == "aborted"
        assert monitor.obey("DO w = 1") in (
            "interrupted: the arm stands",
            "interrupted: the arm stands; PROCEED goes on",
        )
