"""Programs of VAL that were stopped go on as if they had not been: with their motions, speeds, hand and run signal."""

from __future__ import annotations

import pytest

from qrobot.errors import ProgramError
from qrobot.val.interpreter import RunState
from qrobot.val.source import read_source
from tests.support.val_runs import interpreter, main_program

PLACES = """
.LOCATIONS
a 450 150 0 90 90 0
b 450 -150 0 90 90 0
c 500 0 200 45 0 0
far 2000 0 0 90 90 0
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
