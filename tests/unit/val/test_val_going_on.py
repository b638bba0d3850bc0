"""Programs of VAL that were stopped go on as if they had not been: with their motions, speeds, hand and run signal."""

from __future__ import annotations

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
