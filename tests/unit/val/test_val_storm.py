"""The monitor of VAL II in the hands of somebody who types anything, and hits Ctrl-C whenever it suits him."""

from __future__ import annotations

import os
import random
import signal
from pathlib import Path

import pytest

from qrobot.rccl.offline import OfflineLink
from qrobot.val.monitor import ValMonitor
from tests.support.val_runs import interpreter

CELL = """
.PROGRAM main
x = 1
MOVE a
MOVES b
y = 2/x
PAUSE
MOVE a
x = x+1
SIGNAL 3
.END
.PROGRAM deep(n)
CALL deep(n+1)
.END
.PROGRAM bad
x = 1/0
.END
.PROGRAM far
MOVE TRANS(5000,0,0,90,-90,0)
.END
.PROGRAM ask
PROMPT "n", k
DELAY k
.END
.PROGRAM beside
SIGNAL 2001
WAIT SIG(2002)
.END
.PROGRAM react
REACTI 2001, bad
PCEXECUTE beside
MOVE a
MOVE b
.END
.PROGRAM check
READY
LEFTY
MOVE c
MOVES d
BREAK
.END
.LOCATIONS
a 450 150 0 90 90 0
b 500 100 100 90 90 0
c 450 150 0 90 90 0
d 500 100 100 90 90 0
.END
"""
TYPED = """
EX main|EX main,2|EX main,2,3|EX main,-1|EX deep(1)|EX bad|EX far|EX ask|EX react|EX beside|XSTEP main
XSTEP far,1,2|NEXT|NEXT|PROCEED|PROCEED|RETRY|ABORT|DO MOVE a|DO MOVES b|DO BREAK|DO READY|DO CALL main
DO CALL bad|DO PAUSE|DO HALT|DO RETURN|DO x = 1/0|DO MOVE nowhere|DO DRIVE 1,10,50|DO DRIVE 9,10,50
DO DRIVE 1,1E9,50|DO SPEED -1|DO SPEED 1E308|DO SPEED 1E-308|DO DELAY 1E300|DO SIGNAL 0|DO x[99999999] = 1
DO x = SQRT(-1)|DO TOOL TRANS(1E300,0,0)|DO TOOL a|DO BASE 1E9,0,0,0|DO END|DO PCEXECUTE react
DO REACTI 2001, bad|DO SIGNAL 2001|DO RESET|DO LOCK 300|DO WAIT SIG(2003)|DO PROMPT "x", x|DO TYPE /C9999|HERE a
HERE 3|POINT a = b:b|POINT a = TRANS(1E400,0,0)|WHERE|LISTP|LISTL|LISTR|DELETEP main|DELETEL a|DELETEL x[1/0]
DELETER x|LOAD /|LOAD /dev/zero|LOAD /proc/self/mem|STORE /|STORE /nonexistent/x.v2|SPEED 10|SPEED 1e-300
SPEED inf|IO|STATUS|CAL|?|DO x = 1/|DO PARAMETER HAND.TIME = 1E300|DO OPENI|DO CLOSEI|DO DEPART 50
DO APPRO a,1E9|DO ALIGN|DO SET a = SCALE(a BY 0)|EX main,--5|EX main,99999999999999999999|EX main,٣|DO é
EX\tmain|LOAD a\0b|STORE a\0b|\x1b[2J
"""
COMMANDS = [*TYPED.strip().replace("\n", "|").split("|"), "EX main," + "9" * 5000, "x" * 9999, "DO x = " + "(" * 3000]
PUT_IN_ORDER = "ABORT|DO IGNORE 2001|DO TOOL NULL|DO BASE 0,0,0,0|DO PARAMETER HAND.TIME = 0|SPEED 100|EX check"
LONGEST = 400  # characters of an answer to what is no list
STORMS = 40


@pytest.mark.sampled(10)
@pytest.mark.parametrize("seed", range(STORMS))
def test_whatever_is_typed_is_answered_and_the_next_program_runs(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn, exchange = random.Random(seed), OfflineLink.exchange
    until_ctrl_c = [0]

    def exchanged(link, command):
        until_ctrl_c[0] -= 1
        if until_ctrl_c[0] == 0:
            os.kill(os.getpid(), signal.SIGINT)
        return exchange(link, command)

    monkeypatch.setattr(OfflineLink, "exchange", exchanged)
    with interpreter(CELL, *["1", "x", "", "nan", "1e999", "-5"] * 10) as (run, _):
        monitor = ValMonitor(run)
        for line in drawn.choices(COMMANDS, k=10):
            until_ctrl_c[0] = drawn.choice([1, 5, 50, 300])
            answer = monitor.obey(line)
            assert answer.replace("\n", " ").isprintable()
            assert len(answer) < LONGEST or "\n" in answer
        until_ctrl_c[0] = 0
        assert [monitor.obey(line) for line in PUT_IN_ORDER.split("|")][-1] == "completed"


def test_a_file_is_stored_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "cell.v2"
    with interpreter(CELL) as (run, _):
        monitor = ValMonitor(run)
        assert monitor.obey(f"STORE {file}") == ""
        stored = file.read_text()
        monitor.obey("DO x = 5")
        monkeypatch.setattr(os, "fsync", lambda _: (_ for _ in ()).throw(OSError(28, "No space left on device")))
        assert monitor.obey(f"STORE {file}") == f"error: cannot write {file}: No space left on device"
    assert file.read_text() == stored
