"""Reactions of VAL while the arm moves: in the last motion, before a question, between steps that wait."""

from __future__ import annotations

import pytest

from qrobot.val.arm import Destination
from qrobot.val.interpreter import RunState
from tests.support.val_runs import PLACES, interpreter, interrupt_at, main_program, number

NEAR_B = "\n.PROGRAM p\nWAIT DISTANCE(HERE, b) < 200\nSIGNAL 2001\n.END\n"
SOON = "\n.PROGRAM p\nWAIT TIMER(1) > 0.2\nSIGNAL 2001\n.END\n"
WHERE = ".PROGRAM r\nwhere = DY(HERE)\n.END\n"
TO_B = "TIMER 1 = 0", "PCEXECUTE p", "MOVE a", "SPEED 20", "MOVES b"


@pytest.mark.parametrize(
    ("end", "rest", "library"),
    [
        ((), "", "rccl"),
        ((), "", "arcl"),
        (("RETURN", "TYPE"), "", "rccl"),
        (("STOP", "TYPE"), "", "rccl"),
        (("HALT", "TYPE"), "", "rccl"),
        (("CALL ends", "TYPE"), ".PROGRAM ends\nHALT\nTYPE\n.END\n", "arcl"),
    ],
)
def test_a_signal_stops_the_arm_in_the_last_motion_too(end: tuple[str, ...], rest: str, library: str) -> None:
    program = main_program("REACTI 2001, r, 5", *TO_B, *end, rest=rest + WHERE + NEAR_B + PLACES)
    with interpreter(program, library=library) as (run, typed):
        assert run.execute("main") is RunState.COMPLETED, run.message
        assert typed == []
        assert 0.0 < number(run, "where") < 50.0  # mm; the signal came at 50
        assert run.machine.frame("here")[1, 3] > 0.0


def test_a_signal_in_the_motion_of_the_last_cycle_counts_and_cycles_are_joined() -> None:
    """The last motion of the first cycle goes on into the first one of the second."""
    text = main_program("REACTI 2001, r, 5", "MOVE a", "SPEED 20", "MOVES b", rest=WHERE + PLACES)
    with interpreter(text) as (run, _):
        arm, rests = run.machine.arm, 0
        sample = arm.sample

        def look() -> None:
            nonlocal rests
            sample()
            rests += arm.idle

        arm.sample = look  # type: ignore[method-assign]
        assert run.execute("main", cycles=2) is RunState.COMPLETED
        assert rests == 1


def test_a_lock_holds_a_reaction_back_in_the_last_motion_too() -> None:
    with interpreter(main_program("REACTI 2001, r, 5", "LOCK 5", *TO_B, rest=WHERE + NEAR_B + PLACES)) as (run, _):
        assert run.execute("main") is RunState.COMPLETED
        assert run.machine.frame("here")[1, 3] == pytest.approx(-0.15, abs=1e-6)
        assert ("where", ()) not in run.machine.values


@pytest.mark.parametrize("beside", [False, True])
def test_a_question_is_asked_when_the_arm_stands_so_a_signal_stops_it_before(beside: bool) -> None:
    question = ["PCEXECUTE q"] if beside else ['PROMPT "n", x']
    q = '\n.PROGRAM q\nPROMPT "n", x\n.END\n'
    lines = "REACTI 2001, r", *TO_B, *question, "BREAK", "y = DY(HERE)"
    with interpreter(main_program(*lines, rest=q + WHERE + NEAR_B + PLACES), "7") as (run, typed):
        stood = []

        def ask(text: str) -> str:
            stood.append(run.machine.arm.idle)
            return typed.ask(text)

        run.machine.ask = ask
        assert run.execute("main") is RunState.COMPLETED, run.message
        assert stood == [True]
        assert number(run, "x") == 7.0
        assert 0.0 < number(run, "where") < 50.0
        assert number(run, "y") == pytest.approx(number(run, "where"), abs=0.1)


def test_a_reaction_between_steps_is_called_between_steps_that_wait() -> None:
    """The signal comes on the way to `a`; the arm is there when the program is called."""
    lines = "REACT 2001, r", "TIMER 1 = 0", "PCEXECUTE p", "MOVE a", "BREAK", "MOVES b", "BREAK", "MOVES a", "BREAK"
    with interpreter(main_program(*lines, rest=WHERE + SOON + PLACES)) as (run, _):
        assert run.execute("main") is RunState.COMPLETED
        assert number(run, "where") == pytest.approx(150.0, abs=1e-3)


@pytest.mark.parametrize("handler", ["", "RETURN\n"])
def test_a_step_goes_on_waiting_behind_a_reaction(handler: str) -> None:
    lines = "REACTI 2001, r", "TIMER 1 = 0", "PCEXECUTE p", "DELAY 3", "x = TIMER(1)"
    with interpreter(main_program(*lines, rest=f".PROGRAM r\n{handler}.END\n" + SOON)) as (run, _):
        assert run.execute("main") is RunState.COMPLETED
        assert number(run, "x") >= 3.0


def test_a_signal_stops_the_motion_of_a_single_step() -> None:
    with interpreter(main_program("REACTI 2001, r, 5", *TO_B, "x = 1", rest=WHERE + NEAR_B + PLACES)) as (run, _):
        told = [run.message] if run.execute("main", single=True) is RunState.PAUSED else []
        while run.state is RunState.PAUSED:
            run.proceed(single=True)
            told.append(run.message)
        assert run.state is RunState.COMPLETED
        assert "at step 1 of program r" in told
        assert 0.0 < number(run, "where") < 50.0
        assert run.machine.frame("here")[1, 3] > 0.0


@pytest.mark.parametrize("library", ["rccl", "arcl"])
@pytest.mark.parametrize("lines", [("REACTI 2001, r, 5", *TO_B), (*TO_B, "WAIT DISTANCE(HERE, b) < 200", "BRAKE")])
def test_a_motion_that_a_program_has_stopped_stays_given_up_behind_ctrl_c(lines: tuple[str, ...], library: str) -> None:
    with interpreter(main_program(*lines, "x = 1", rest=WHERE + NEAR_B + PLACES), library=library) as (run, _):
        arm, stops = run.machine.arm, 0
        stop, sample = arm.stop, arm.sample

        def stop_and_count() -> None:
            nonlocal stops
            stop()
            stops += 1

        def look() -> None:
            sample()
            if stops == 1:
                raise KeyboardInterrupt

        arm.stop, arm.sample = stop_and_count, look  # type: ignore[method-assign]
        with pytest.raises(KeyboardInterrupt):
            run.execute("main")
        assert run.state is RunState.PAUSED
        assert run.proceed() is RunState.COMPLETED, run.message
        assert number(run, "x") == 1.0
        assert 0.0 < run.machine.frame("here")[1, 3] < 0.06


@pytest.mark.parametrize("library", ["rccl", "arcl"])
@pytest.mark.parametrize(
    ("waits", "hands"),
    [(["WAIT DISTANCE(HERE, b) < 200"], []), (["WAIT DISTANCE(HERE, b) < 50", "WAIT DISTANCE(HERE, b) > 100"], [True])],
)
def test_a_hand_opens_with_its_motion_and_not_where_the_arm_was_stopped_before(
    waits: list[str], hands: list[bool], library: str
) -> None:
    """OPEN is for the motion that begins at `b`; the signal comes on the way there, or on the way back."""
    lines = "REACTI 2001, r", "MOVE a", "SPEED 20", "MOVES b", "OPEN", "PCEXECUTE p", "SPEED 20", "MOVES a", "BREAK"
    watch = "\n".join(["", ".PROGRAM p", *waits, "SIGNAL 2001", ".END", ""])
    with interpreter(main_program(*lines, rest=WHERE + watch + PLACES), library=library) as (run, _):
        opened: list[bool] = []
        run.machine.arm.hand = opened.append  # type: ignore[method-assign]
        assert run.execute("main") is RunState.COMPLETED, run.message
        assert opened == hands


def test_a_wrong_answer_behind_a_reaction_is_blamed_on_its_question_which_retry_asks_again() -> None:
    lines = "REACTI 2001, r", *TO_B, 'PROMPT "n", x', "y = x"
    with interpreter(main_program(*lines, rest=WHERE + NEAR_B + PLACES), "abc", "7") as (run, _):
        assert run.execute("main") is RunState.FAILED
        assert run.message.startswith("program main, line 8, column 1: PROMPT: expected a number, not 'abc'")
        assert run.retry() is RunState.COMPLETED, run.message
        assert number(run, "y") == 7.0


PULSE = """
.PROGRAM pulse
TIMER 1 = 0
WAIT TIMER(1) > 0.2
SIGNAL 2001
WAIT TIMER(1) > 0.4
SIGNAL -2001
.END
.PROGRAM count
n = n+1
SIGNAL 2002
.END
.REALS
n 0
.END
"""
HELD_BACK = "PCEXECUTE pulse, 2", "DELAY 1"
"""The signal has come and gone twice behind these steps."""


@pytest.mark.parametrize(
    ("lines", "called"),
    [
        (("REACT 2001, count, 5", *HELD_BACK, "x = n"), 1),
        (("REACTI 2001, count, 5", "LOCK 5", *HELD_BACK, "x = -n", "LOCK 0", "x = n+x"), 1),
        (("REACTI 2001, count, 5", *HELD_BACK, "x = n"), 2),
        (("REACT 2001, count, 5", "LOCK 5", *HELD_BACK, "IGNORE 2001", "LOCK 0", "x = n"), 0),
        (("REACT 2001, count, 5", "LOCK 5", *HELD_BACK, "REACT 2001, count, 5", "LOCK 0", "x = n"), 0),
        (("REACT -2001, count, 5", "LOCK 5", *HELD_BACK, "x = -n", "LOCK 0", "x = n+x"), 1),
    ],
)
def test_a_signal_that_came_and_went_while_its_reaction_was_held_back_counts_once(
    lines: tuple[str, ...], called: int
) -> None:
    with interpreter(main_program(*lines, "LOCK 0", rest=PULSE)) as (run, _):
        assert run.execute("main") is RunState.COMPLETED, run.message
        assert number(run, "x") == called
        assert run.machine.signal_is_on(2002) == (called > 0)


ENTER = """
.PROGRAM enter
LOCK 10
SIGNAL 2001
.END
.PROGRAM leave
LOCK 0
.END
.PROGRAM locks
n = n+1
LOCK 20
.END
"""


def test_a_lock_in_a_program_that_is_called_holds_behind_its_return() -> None:
    lines = "REACTI 2001, count, 5", "CALL enter", "x = n", "CALL leave", "y = n"
    with interpreter(main_program(*lines, rest=ENTER + PULSE)) as (run, _):
        assert run.execute("main") is RunState.COMPLETED, run.message
        assert (number(run, "x"), number(run, "y")) == (0.0, 1.0)


def test_a_lock_ends_with_the_cycle() -> None:
    """The signal of the first one is pending when the second one begins."""
    lines = "IF n == 0 THEN", "REACTI 2001, count, 5", "END", "LOCK 10", "SIGNAL 2001"
    with interpreter(main_program(*lines, rest=PULSE)) as (run, _):
        assert run.execute("main", cycles=2) is RunState.COMPLETED, run.message
        assert number(run, "n") == 1.0


def test_the_return_of_a_reaction_restores_the_priority_before_it() -> None:
    lines = (
        "REACTI 2001, locks, 5",
        "LOCK 4",
        "SIGNAL 2001",
        "TYPE",
        "SIGNAL -2001",
        "TYPE",
        "SIGNAL 2001",
        "TYPE",
        "x = n",
    )
    with interpreter(main_program(*lines, rest=ENTER + PULSE)) as (run, _):
        assert run.execute("main") is RunState.COMPLETED, run.message
        assert number(run, "x") == 2.0


ASKED = "\n.PROGRAM r\n{}\n.END\n"


@pytest.mark.parametrize("library", ["rccl", "arcl"])
@pytest.mark.parametrize(
    ("asked", "reaction", "shares", "hands"),
    [
        (("SPEED 20", "OPEN"), "MOVE a", [1.0, 0.2], [(2, True)]),
        (("SPEED 20", "OPEN"), "SPEED 50\nCLOSE\nMOVE a", [0.5, 0.2], [(1, False), (2, True)]),
        (("SPEED 20", "OPEN"), "SPEED 50\nCLOSE", [0.2], [(1, True)]),
        ((), "SPEED 50\nCLOSE", [0.5], [(1, False)]),
    ],
)
def test_what_is_asked_of_the_next_motion_is_not_for_the_motion_of_a_reaction(
    library: str,
    asked: tuple[str, ...],
    reaction: str,
    shares: list[float],
    hands: list[tuple[int, bool]],
) -> None:
    """The reaction comes between OPEN and the motion that it is for, and would let go what the hand holds."""
    lines = "REACT 2001, r", *asked, "SIGNAL 2001", "MOVE b", "BREAK"
    with interpreter(main_program(*lines, rest=ASKED.format(reaction) + PLACES), library=library) as (run, _):
        gone: list[float] = []
        opened: list[tuple[int, bool]] = []
        move = run.machine.arm.move

        def record(destination: Destination) -> None:
            gone.append(destination.share)
            move(destination)

        run.machine.arm.move = record  # type: ignore[method-assign]
        run.machine.arm.hand = lambda on: opened.append((len(gone), on))  # type: ignore[method-assign]
        assert run.execute("main") is RunState.COMPLETED, run.message
        assert gone == pytest.approx(shares)
        assert opened == hands


def test_what_was_asked_of_a_motion_that_failed_is_not_for_the_one_that_leads_out_of_it() -> None:
    out = "\n.PROGRAM r\nMOVE a\n.END\n.LOCATIONS\nfar 3000 0 0 90 90 0\n.END\n"
    lines = "REACTE r", "SPEED 20", "LEFTY", "MOVE far", "MOVE b"
    with interpreter(main_program(*lines, rest=out + PLACES)) as (run, _):
        gone: list[tuple[str, float, str]] = []
        move = run.machine.arm.move

        def record(destination: Destination) -> None:
            move(destination)
            gone.append((destination.name, destination.share, destination.letters))

        run.machine.arm.move = record  # type: ignore[method-assign]
        assert run.execute("main") is RunState.COMPLETED, run.message
        assert gone == [("a", 1.0, ""), ("b", 1.0, "")]


@pytest.mark.parametrize("typed", ["BRAKE", "CALL sub"])
def test_what_is_typed_takes_no_hand_from_a_program_that_is_paused(typed: str) -> None:
    """`sub` has a reaction of its own, and an error that REACTE takes."""
    sub = "\n.PROGRAM sub\nREACT 2001, r\nSIGNAL 2001\nREACTE r\nn = 1/0\n.END\n" + ASKED.format("m = 1")
    lines = "MOVE a", "OPEN", "SPEED 20", "PAUSE", "MOVE b", "BREAK"
    with interpreter(main_program(*lines, rest=sub + PLACES)) as (run, _):
        opened: list[bool] = []
        run.machine.arm.hand = opened.append  # type: ignore[method-assign]
        assert run.execute("main") is RunState.PAUSED
        run.do(typed)
        assert opened == []
        begin_s = run.machine.arm.time_s
        assert run.proceed() is RunState.COMPLETED, run.message
        assert opened == [True]
        assert run.machine.arm.time_s - begin_s > 2.0  # at a fifth of the speed


def test_a_brake_that_is_typed_while_a_motion_waits_leaves_that_its_hand() -> None:
    with interpreter(main_program("MOVE a", "OPEN", "MOVE b", "BREAK", rest=PLACES)) as (run, _):
        opened: list[bool] = []
        arm = run.machine.arm
        arm.hand = opened.append  # type: ignore[method-assign]
        interrupt_at(run, 8)
        with pytest.raises(KeyboardInterrupt):
            run.execute("main")
        assert arm.q != pytest.approx(run.machine.robot.poses["park"], abs=0.01)
        run.do("BRAKE")
        assert opened == []
        assert run.proceed() is RunState.COMPLETED, run.message
        assert opened == [True]
