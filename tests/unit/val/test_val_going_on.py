"""Programs of VAL that were stopped go on as if they had not been: with their motions, speeds, hand and run signal."""

from __future__ import annotations

import pytest

from qrobot.arrays import Floats
from qrobot.errors import MotionError, ProgramError
from qrobot.val.arm import Destination
from qrobot.val.interpreter import RunState
from qrobot.val.source import read_source
from tests.support.puma import PARK
from tests.support.val_runs import interpreter, interrupt_at, main_program

PLACES = """
.LOCATIONS
a 450 150 0 90 90 0
b 450 -150 0 90 90 0
c 500 0 200 45 0 0
far 2000 0 0 90 90 0
#q 10 -50 175 5 50 5
.END
"""


def test_an_error_whose_program_cannot_be_called_stops_the_arm() -> None:
    bad = ".PROGRAM bad\nIF 1 THEN\nx = 2\n.END\n"
    with interpreter(main_program("REACTE bad", "MOVE a", "x = 1/0", "MOVE b", rest=bad + PLACES)) as (run, _):
        assert run.execute("main") is RunState.FAILED
        assert run.message.startswith("program main, line 4, column 6: 1 / 0 is no number; and REACTE: program bad")
        assert run.machine.arm.idle
        run.machine.load(read_source(".PROGRAM bad\nx = 2\n.END\n")[0])
        assert run.retry() is RunState.COMPLETED  # by the mended program
        assert run.machine.values["x", ()] == 2.0


def test_steps_that_are_typed_take_no_speed_configuration_or_hand_of_a_paused_program() -> None:
    """Those that are typed count for the next typed motion, or else for the program."""
    lines = "MOVE a", "BREAK", "OPEN", "LEFTY", "SPEED 10", "MOVES far", "BREAK", "PAUSE", "SPEED 10 MMPS", "MOVE far"
    with interpreter(main_program(*lines, rest=PLACES)) as (run, _):
        arm, machine, hands, speeds = run.machine.arm, run.machine, [], []
        move = arm.move
        arm.hand = hands.append  # type: ignore[method-assign]
        arm.move = lambda destination: (speeds.append(destination.share), move(destination))[1]  # type: ignore[method-assign]
        assert run.execute("main") is RunState.FAILED
        assert hands == []
        speeds.clear()
        run.do("MOVES SHIFT(a BY 10)")
        run.do("SPEED 50")
        run.do("MOVES a")
        assert speeds == [0.9 * 0.1, 0.9 * 0.5]
        assert (machine.next_speed, machine.words, hands) == ((10.0, False), "l", [])
        run.do("CLOSE")
        run.do("MOVES SHIFT(a BY 10)")
        assert hands == [False]
        machine.values["far", ()] = machine.values["b", ()]
        assert run.retry() is RunState.PAUSED
        assert speeds[-1] == 0.9 * 0.1
        assert hands == [False, True]
        run.do("SPEED 40")
        assert machine.next_speed == (40.0, False)
        assert run.proceed() is RunState.COMPLETED
        assert machine.next_speed is None


def test_a_drive_that_is_refused_leaves_its_speed_to_nobody() -> None:
    with interpreter(main_program("SPEED 20", "DRIVE 1, 9000, 5", "MOVE a", rest=PLACES)) as (run, _):
        assert run.execute("main") is RunState.FAILED
        assert run.machine.next_speed == (20.0, False)


def test_a_program_that_is_given_up_asks_nothing_of_the_next_motion() -> None:
    with interpreter(main_program("SPEED 10", "LEFTY", "OPEN", "MOVES far", rest=PLACES)) as (run, _):
        assert run.execute("main") is RunState.FAILED
        run.abort()
        assert (run.machine.next_speed, run.machine.words, run.machine.hand_at_next) == (None, "", None)


def test_a_program_that_cannot_begin_leaves_the_speed_of_a_paused_one() -> None:
    with interpreter(main_program("SPEED 10 ALWAYS", "LEFTY", "PAUSE", "MOVE a", rest=PLACES)) as (run, _):
        assert run.execute("main") is RunState.PAUSED
        with pytest.raises(ProgramError, match="has steps 1 to 4"):
            run.execute("main", step=99)
        assert (run.machine.speed, run.machine.next_speed, run.machine.words) == (10.0, (10.0, False), "l")
        assert run.proceed() is RunState.COMPLETED


@pytest.mark.parametrize("given_up", ["by ABORT", "by the next program"])
def test_the_hand_of_a_program_that_is_given_up_stays_as_it_is(given_up: str) -> None:
    other = ".PROGRAM other\nMOVE b\n.END\n"
    with interpreter(main_program("MOVE a", "BREAK", "OPEN", "MOVE far", rest=other + PLACES)) as (run, _):
        hands: list[bool] = []
        run.machine.arm.hand = hands.append  # type: ignore[method-assign]
        assert run.execute("main") is RunState.FAILED
        if given_up == "by ABORT":
            run.abort()
            run.do("MOVE b")
        assert run.execute("other") is RunState.COMPLETED
        assert hands == []


def _ends(lines: tuple[str, ...], library: str, after: tuple[str, ...] = ()) -> Floats:
    """Where the tool is at the end, also when Ctrl-C came on the way to `a` and `after` was typed. Shape (4, 4)."""
    with interpreter(main_program(*lines, rest=PLACES), library=library) as (run, _):
        if not after:
            assert run.execute("main") is RunState.COMPLETED, run.message
            return run.machine.frame("here")
        interrupt_at(run, 8)
        with pytest.raises(KeyboardInterrupt):
            run.execute("main")
        assert run.machine.arm.q != pytest.approx(PARK, abs=0.01)  # on its way
        for step in after[:-1]:
            run.do(step)
        assert run.proceed() is RunState.COMPLETED, run.message
        return run.machine.frame("here")


@pytest.mark.parametrize(
    ("lines", "after", "library"),
    [
        (("MOVE a", "MOVES b", "DEPARTS 100"), ("PROCEED",), "rccl"),
        (("MOVE a", "MOVES b", "DEPARTS 100"), ("MOVE SHIFT(a BY 30)", "PROCEED"), "arcl"),
        (("MOVE a", "MOVE b:TRANS(,,,90,-70)", "ALIGN"), ("PROCEED",), "arcl"),
        (("MOVE a", "MOVE b", "MOVE SHIFT(DEST BY ,,50)"), ("MOVE SHIFT(a BY 30)", "PROCEED"), "rccl"),
        (("MOVE a", "MOVE #q", "DEPART 20"), ("PROCEED",), "rccl"),
        (("MOVE a", "RIGHTY", "MOVE c", "NOFLIP", "MOVE SHIFT(c BY 30)"), ("PROCEED",), "rccl"),
    ],
)
def test_an_interrupted_motion_leads_again_to_the_place_that_the_next_one_departs_from(
    lines: tuple[str, ...], after: tuple[str, ...], library: str
) -> None:
    assert _ends(lines, library, after) == pytest.approx(_ends(lines, library), abs=1e-6)


def test_a_departure_that_failed_is_retried_from_where_the_motion_before_leads() -> None:
    ends = []
    for back in (5000.0, 50.0):
        with interpreter(main_program("MOVE a", "DEPART n", rest=PLACES)) as (run, _):
            run.machine.values["n", ()] = back
            if run.execute("main") is RunState.FAILED:
                run.machine.values["n", ()] = 50.0
                assert run.retry() is RunState.COMPLETED, run.message
            ends.append(run.machine.frame("here"))
    assert ends[0] == pytest.approx(ends[1], abs=1e-6)


def test_motions_that_could_not_be_gone_on_with_are_kept_for_the_next_proceed() -> None:
    """Whether the library refuses one, or Ctrl-C comes in between: none is lost, and none is left out."""
    with interpreter(main_program("MOVE a", "MOVES b", "x = 1", "MOVE a", rest=PLACES)) as (run, _):
        interrupt_at(run, 8)
        with pytest.raises(KeyboardInterrupt):
            run.execute("main")
        arm, gone = run.machine.arm, []
        move, refusals = arm.move, [None, MotionError("not now"), KeyboardInterrupt()]

        def hesitant(destination: Destination) -> None:
            if refusals and (refusal := refusals.pop(0)) is not None:
                raise refusal
            gone.append(destination.name)
            move(destination)

        arm.move = hesitant  # type: ignore[method-assign]
        assert run.proceed() is RunState.FAILED
        assert run.message == "not now"
        with pytest.raises(KeyboardInterrupt):
            run.proceed()
        assert run.state is RunState.PAUSED
        assert run.proceed() is RunState.COMPLETED, run.message
        assert gone == ["a", "a", "b", "a"]
        assert run.machine.values["x", ()] == 1.0


def test_the_signal_of_a_running_program_is_on_while_it_runs_and_at_no_other_time() -> None:
    """It goes off at PAUSE and at Ctrl-C, on with PROCEED, and is nobody's when the program has ended."""
    lines = "RUNSIG 1", "RUNSIG 2", "PAUSE", "x = SIG(2, -1)", "MOVE a", "MOVES b", "BREAK", "y = SIG(2)"
    with interpreter(main_program(*lines, rest=PLACES)) as (run, _):
        assert run.execute("main") is RunState.PAUSED
        assert run.machine.arm.outputs == 0
        run.do("z = SIG(2)")
        interrupt_at(run, 8)
        with pytest.raises(KeyboardInterrupt):
            run.proceed()
        assert run.machine.arm.outputs == 0
        assert run.proceed() is RunState.COMPLETED
        assert [run.machine.values[name, ()] for name in ("x", "y", "z")] == [-1.0, -1.0, 0.0]
        run.do("SIGNAL 2")
        run.do("SIGNAL 1")
        assert run.machine.arm.outputs == 3


def test_a_signal_of_running_that_there_is_not_leaves_the_one_before() -> None:
    with interpreter(main_program("RUNSIG 2", "RUNSIG 99", "x = SIG(2)", "RUNSIG", "y = SIG(2)")) as (run, _):
        assert run.execute("main") is RunState.FAILED
        assert run.machine.arm.outputs == 0
        assert run.proceed() is RunState.COMPLETED
        assert [run.machine.values[name, ()] for name in ("x", "y")] == [-1.0, 0.0]


def test_a_program_beside_has_its_own_signal_of_running() -> None:
    p = ".PROGRAM p\nRUNSIG 3\nWAIT SIG(2001)\n.END\n"
    lines = "RUNSIG 2", "PCEXECUTE p", "WAIT SIG(3)", "SIGNAL 2001", "WAIT SIG(-3)", "x = SIG(2)"
    with interpreter(main_program(*lines, rest=p)) as (run, _):
        assert run.execute("main") is RunState.COMPLETED
        assert run.machine.values["x", ()] == -1.0
        assert run.machine.arm.outputs == 0
