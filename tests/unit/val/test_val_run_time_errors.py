"""Errors of VAL programs at random steps of the examples: the arm stops on its path, the mended program goes on."""

from __future__ import annotations

import random
import re

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.rccl.offline import OfflineLink
from qrobot.val.interpreter import RunState
from qrobot.val.monitor import ValMonitor
from qrobot.val.source import read_source
from tests.support.val_runs import EXAMPLES, interpreter

LIMITS = load_robot("puma560").limits
PERIOD_S = 0.028
# A step that fails, the name that it lacks, what mends it, and a name that it has given a value when it was done.
MISTAKES = {
    "SET zz.spot = zz.place": ("zz.place", "HERE zz.place", "zz.spot"),
    "zz.n = 1/zz.d": ("zz.d", "DO zz.d = 2", "zz.n"),
    "zz.b[2] = zz.a[3]": ("zz.a", "DO zz.a[3] = 1", "zz.b"),
    "zz.n = DISTANCE(HERE, zz.place)": ("zz.place", "HERE zz.place", "zz.n"),
}
LATE = "05_machine_handshake"  # waits for a machine by a timer, which goes on while the program is mended
RECOVERS = "10_recover"  # hands errors to a program of its own
SEED = 3  # draws three steps of process control programs


def broken(text: str, mistake: str, drawn: random.Random) -> tuple[str, int]:
    """The file with a mistake at a random step, and the number of its line."""
    lines = text.splitlines()
    end = next(i for i, line in enumerate(lines) if line.startswith(".LOCATIONS"))
    while True:
        at = drawn.randrange(end)
        with_it = "\n".join([*lines[:at], mistake, *lines[at:]])
        if not read_source(with_it)[1]:
            return with_it, at + 1


@pytest.mark.sampled(3)
@pytest.mark.parametrize("file", [f for f in sorted(EXAMPLES.glob("*.v2")) if f.stem != RECOVERS], ids=lambda f: f.stem)
def test_a_mended_program_ends_as_if_nothing_had_been(file, monkeypatch) -> None:
    drawn = random.Random(f"{file.stem}{SEED}")
    mistake = drawn.choice(list(MISTAKES))
    lacks, remedy, given = MISTAKES[mistake]
    sent, exchange = [], OfflineLink.exchange

    def exchanged(link, command):
        state = exchange(link, command)
        sent.append(state.robot.q_setpoint)
        return state

    text = file.read_text()
    with interpreter(text) as (run, expected):
        whole = run_through(run)
    monkeypatch.setattr(OfflineLink, "exchange", exchanged)
    wrong, line = broken(text, mistake, drawn)
    with interpreter(wrong) as (run, typed):
        state = run.execute("main")
        while state is RunState.PAUSED and run.message.startswith("PAUSE"):
            state = run.proceed()
        if state is RunState.FAILED:
            said = rf"line {line}, column \d+: .*{re.escape(lacks)} is not defined"
            assert re.search(said, run.message.replace("\n", " "))
            assert run.machine.arm.idle
            assert ValMonitor(run).obey(remedy) == ""
            state = run.retry()
            assert any(name == given for name, _ in run.machine.values)
        while state is RunState.PAUSED and run.message.startswith("PAUSE"):
            state = run.proceed()
        assert state is whole
        assert list(typed) == list(expected) or file.stem == LATE
    path = np.array(sent)
    assert (np.abs(np.diff(path, axis=0)) <= LIMITS.v_max * PERIOD_S * 1.001).all()
    assert (np.abs(np.diff(path, 2, axis=0)) <= LIMITS.a_max * PERIOD_S**2 * 1.001).all()


def run_through(run) -> RunState:
    state = run.execute("main")
    while state is RunState.PAUSED:
        state = run.proceed()
    return state
