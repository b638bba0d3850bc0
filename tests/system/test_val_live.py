"""VAL II programs in real time, over the bridge of a running arm, beside the same programs off line."""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np
import pytest

from qrobot.arrays import Floats
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.cli.motion_figures import farthest_off, path_of
from qrobot.faultcodes import FaultCode
from qrobot.val.interpreter import Interpreter, RunState
from qrobot.val.source import read_source
from tests.support.processes import RunningArm, events_of
from tests.support.puma import ROBOT
from tests.support.shared_arm import SharedArm
from tests.support.stall_watch import ANY_TIME_S, StreamLostError, unless_stalled
from tests.support.val_runs import EXAMPLES, interpreter

pytestmark = pytest.mark.realtime

SPEEDS = {"06_process_control": 25, "07_pause_and_proceed": 100, "10_recover": 100}  # of each program, percent
BY_ARCL = "07_pause_and_proceed.v2"
QUESTION = "PAUSE in program main; return goes on "
THERE_RAD = 0.01
OFF_MM = 12.0  # the servo is about 6 mm beside the way at full speed
GLUE_MM, LATE_MM = 100.0, 60.0  # of y to either side, in 06_process_control; two samples of 100 ms at 0.25 m/s


def test_three_programs_do_on_a_running_arm_what_they_do_off_line(
    shared_arm: SharedArm,
    arm: RunningArm,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("QROBOT_BRIDGE", f"{arm.arm.bridge.host}:{arm.arm.bridge.port}")
    files = [_at_speed(speed, EXAMPLES / f"{name}.v2", tmp_path) for name, speed in SPEEDS.items()]
    with interpreter(period_ms=arm.arm.bridge.period_ms) as (off_line, typed):
        asked = [_run_off_line(off_line, file.read_text()) for file in files]

    def run_them() -> tuple[int, list[str]]:
        """When they began, and what they typed."""
        shared_arm.park()  # the first place can be reached from there: also where this test is run again
        begun_ns, told = arm.now_ns(), ""
        for file, way in zip(files, asked, strict=True):
            monkeypatch.setattr("sys.stdin", io.StringIO("\n"))  # the answer to PAUSE
            words = ["val", "run", "--deployment", str(arm.deployment), "--speed", "100", str(file)]
            words += ["--library", "arcl"] if file.name == BY_ARCL else []
            status = run_app(make_app("val"), words)
            out, err = capsys.readouterr()
            if FaultCode.STREAM_LOST.name in out + err:  # all of this is one process, which may be kept from running
                raise StreamLostError(out + err, ANY_TIME_S)
            assert status == 0, err
            assert arm.snapshot().q == pytest.approx(way[-1], abs=THERE_RAD)
            told += out
        return begun_ns, told.replace(QUESTION, "").splitlines()

    begun_ns, told = unless_stalled(run_them, shared_arm.put_in_order)
    assert told == typed
    rows = arm.telemetry()
    rows = rows[rows["t_ns"] >= begun_ns]
    assert not events_of(rows)
    rows = rows[::20]
    measured = path_of(ROBOT, rows["q"])
    assert farthest_off(path_of(ROBOT, np.concatenate(asked)), measured) < OFF_MM
    glued = measured[(rows["outputs"] & 1) == 1, 1]
    assert np.ptp(glued) > GLUE_MM
    assert np.abs(glued).max() < GLUE_MM + LATE_MM


def _at_speed(percent: int, file: Path, folder: Path) -> Path:
    """The program at this speed, without its way home: a test on the wall clock shall be short."""
    copy, text = folder / file.name, re.sub(r"^ +READY$", "", file.read_text(), flags=re.MULTILINE)
    text = re.sub(r"SPEED \d+", f"SPEED {percent}", text)
    copy.write_text(text)
    return copy


def _run_off_line(run: Interpreter, text: str) -> Floats:
    """Joint positions at each sample. Shape (samples, 6)."""
    way, sample = [run.machine.arm.q], run.machine.arm.sample

    def record() -> None:
        sample()
        way.append(run.machine.arm.q)

    source, _ = read_source(text)
    run.machine.load(source)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run.machine.arm, "sample", record)
        state = run.execute("main")
        state = run.proceed() if state is RunState.PAUSED else state
    assert state is RunState.COMPLETED, run.message
    return np.array(way)
