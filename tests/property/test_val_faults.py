"""Mistakes at random steps of the example programs of VAL II, while motions are queued, and going on after them."""

from __future__ import annotations

import random
import re

import numpy as np
import pytest

from qrobot.arrays import Floats
from qrobot.cli.motion_figures import farthest_off, path_of
from qrobot.val.interpreter import Interpreter, RunState
from qrobot.val.source import read_source
from tests.support.puma import ROBOT
from tests.support.val_runs import EXAMPLES, interpreter

DEEP = "CALL fault.deep"  # as deep as before at a RETRY: PROCEED leads back
FAULTS = {
    "fault.x = 1/fault.zero": "1 / 0 is no number",
    "MOVE fault.nowhere": "the value of fault.nowhere is not defined",
    "MOVES fault.far": "out of the arm's reach",
    "MOVE fault.kind": "expected a location, not a number",
    "fault.x = fault.array[fault.index]": "indices of fault.array are 0 to",
    DEEP: "calls are 100 deep",
    "CALL fault.missing": "there is no program fault.missing",
    "REACT 2032, fault.handler, 99\nSIGNAL 2032\nfault.x = 0": "1 / 0 is no number",
    "PCEXECUTE fault.handler\nBREAK": "1 / 0 is no number",
}
HELPERS = """
.PROGRAM fault.deep
IF fault.without.end THEN
CALL fault.deep
END
.END
.PROGRAM fault.handler
fault.x = 1/fault.zero
.END
.LOCATIONS
fault.far 3000 0 0 90 90 0
.END
.REALS
fault.zero 0
fault.kind 0
fault.without.end -1
fault.array[1] 1
fault.index -1
.END
"""
FILES = [file for file in sorted(EXAMPLES.glob("*.v2")) if file.stem != "10_recover"]  # REACTE takes its mistakes
OFF_MM = 25.0  # an arm that stops before a corner does not go round it
STEP_RAD = 0.15  # of a joint in one sample


@pytest.mark.sampled(2)
@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_a_mistake_stops_the_arm_on_its_path_and_the_program_goes_on(file) -> None:
    draw = random.Random(f"116 {file.stem}")
    usual, _, typed = _run_through(file.read_text(), "")
    for fault in draw.sample(sorted(FAULTS), 2):
        text = _with_fault(file.read_text(), fault, draw)
        way, stop, answers = _run_through(text + HELPERS, fault)
        assert answers == typed, fault
        assert np.abs(np.diff(way, axis=0)).max() < STEP_RAD, fault
        assert way[-1] == pytest.approx(usual[-1], abs=1e-6), fault
        assert farthest_off(path_of(ROBOT, usual), path_of(ROBOT, way[:stop])) < OFF_MM, fault


def _run_through(text: str, fault: str) -> tuple[Floats, int, list[str]]:
    """Joint positions at each sample, (samples, 6), how many until the fault, which is mended, and what was typed."""
    source, errors = read_source(text)
    assert errors == []
    with interpreter() as (run, typed):
        way, sample = [run.machine.arm.q], run.machine.arm.sample

        def record() -> None:
            sample()
            way.append(run.machine.arm.q)

        run.machine.arm.sample = record  # type: ignore[method-assign]
        run.machine.load(source)
        state = _past_pauses(run, run.execute("main"))
        stop = len(way)
        if fault:
            state = _mended(run, text, fault)
        assert state is RunState.COMPLETED, run.message
        return np.array(way), stop, list(typed)


def _past_pauses(run: Interpreter, state: RunState) -> RunState:
    return run.proceed() if state is RunState.PAUSED else state


def _mended(run: Interpreter, text: str, fault: str) -> RunState:
    """Look at the failure, take its cause away, and go on by RETRY, or by PROCEED."""
    told = re.match(r"(beside: )?program (\S+), line (\d+), column \d+: ", run.message)
    assert run.state is RunState.FAILED, run.message
    assert told is not None, run.message
    assert FAULTS[fault] in run.message
    assert "fault." in text.splitlines()[int(told[3]) - 1]
    assert run.machine.arm.idle
    values = run.machine.values
    values |= {("fault.zero", ()): 1.0, ("fault.index", ()): 1.0, ("fault.without.end", ()): 0.0}
    run.machine.load(read_source(".PROGRAM fault.missing\n.END")[0])
    again = not fault.startswith(("MOVE", DEEP))
    state = _past_pauses(run, run.retry() if again else run.proceed())
    while state is RunState.FAILED and fault.startswith("MOVE"):  # in a loop
        state = _past_pauses(run, run.proceed())
    return state


def _with_fault(text: str, fault: str, draw: random.Random) -> str:
    """The text with a mistake in a random line of the program that moves the arm, behind a motion."""
    lines = text.splitlines()
    first, end = lines.index(".PROGRAM main") + 1, lines.index(".END")
    places = [at for at in range(first, end) if re.match(r"\s+(MOVE|APPRO|DEPART|OPEN|CLOSE)", lines[at])]
    at = draw.choice(places or [end - 1]) + 1
    return "\n".join([*lines[:at], fault, *lines[at:]])
