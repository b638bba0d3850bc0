"""What the demo does when the machine it runs on stalls."""

from __future__ import annotations

import json
import subprocess
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from qrobot.cli.console import run_app
from qrobot.cli.demo import _draw, _tried_twice
from qrobot.cli.main import make_app
from qrobot.config import load_robot
from qrobot.errors import LinkTimeout, LogError, QRobotError, Stalled
from qrobot.faultcodes import FaultCode
from qrobot.log.header import header_for
from qrobot.log.read import Log
from qrobot.log.record import write_log
from qrobot.log.summary import tracking_summary
from qrobot.modecodes import Mode
from qrobot.rig.demo_criteria import judge
from qrobot.rig.experiment import STALLS, ExperimentRun, Result, _result, run_realtime, stalled_before_fault
from qrobot.servo.memory.telemetry import FLAG_UNSEEN, TelemetryLayout
from tests.support.log_samples import make_rows
from tests.support.processes import write_deployment


class Attempts:
    """Fails with these errors, one after the other, and then succeeds."""

    def __init__(self, *errors: Exception) -> None:
        self.errors, self.made = list(errors), 0

    def __call__(self) -> Result:
        self.made += 1
        if self.errors:
            raise self.errors.pop(0)
        log = log_of_a_fault()
        return Result(ExperimentRun(1000, "realtime"), log, tracking_summary(log), 1.0, "")


@pytest.fixture
def told() -> list[str]:
    return []


def test_a_run_that_a_stall_stopped_is_made_once_more_and_people_are_told_why(told: list[str]) -> None:
    attempts = Attempts(Stalled("BOARD_GONE"))
    assert _tried_twice(attempts, told.append).made_again == "BOARD_GONE"
    assert attempts.made == 2
    assert "BOARD_GONE" in told[0]
    assert _tried_twice(Attempts(), told.append).made_again == ""


def test_a_machine_that_stalls_again_is_an_error(told: list[str]) -> None:
    with pytest.raises(Stalled):
        _tried_twice(Attempts(Stalled("first"), Stalled("second")), told.append)


def test_a_program_that_does_not_end_is_ended_and_told_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ended: list[str] = []
    hangs = SimpleNamespace(name="program", process=SimpleNamespace(wait=_never_over))
    processes: Any = SimpleNamespace(start_program=lambda _path: hangs, rig=SimpleNamespace(end=ended.append))
    monkeypatch.setattr("qrobot.rig.experiment._servo_running", lambda *_all: nullcontext())
    with pytest.raises(LinkTimeout, match="did not end within 120 s"):
        run_realtime(ExperimentRun(1000, "realtime"), processes, tmp_path)
    assert ended == ["program"]


def _never_over(patience_s: float) -> int:
    raise subprocess.TimeoutExpired("program", patience_s)


def test_what_the_arm_did_is_not_tried_again(told: list[str]) -> None:
    attempts = Attempts(QRobotError("COLLISION"))
    with pytest.raises(QRobotError, match="COLLISION"):
        _tried_twice(attempts, told.append)
    assert (attempts.made, told) == (1, [])
    assert STALLS.isdisjoint({"COLLISION", "FOLLOWING", "ENC_STUCK", "JOINT_LIMIT"})


PERIOD_NS, FAULT_ROW = 1_000_000, 150
STALLS_OF = pytest.mark.parametrize(  # so many cycles, up to that row
    ("cycles", "row", "stalled"), [(6, 130, True), (3, 130, False), (6, 80, False), (6, 160, False)]
)


def log_of_a_fault() -> Log:
    """A punctual run of 200 cycles that ends in RUNAWAY."""
    rows = TelemetryLayout(6).empty(200)
    rows["tick"] = np.arange(200)
    rows["t_ns"] = PERIOD_NS * rows["tick"]
    rows["mode"] = Mode.TRACKING
    rows["mode"][FAULT_ROW:], rows["fault"][FAULT_ROW:] = Mode.FAULT, FaultCode.RUNAWAY
    return Log(Path("a.mcap"), header_for(load_robot("puma560"), PERIOD_NS, "qrobot"), rows)


def test_a_fault_on_a_punctual_machine_is_the_arms() -> None:
    assert not stalled_before_fault(log_of_a_fault())


@STALLS_OF
def test_a_fault_soon_after_images_stayed_away_for_long_is_the_machines(cycles: int, row: int, stalled: bool) -> None:
    log = log_of_a_fault()
    log.rows["flags"][row - cycles : row] |= FLAG_UNSEEN
    assert stalled_before_fault(log) is stalled


@STALLS_OF
def test_so_is_one_soon_after_the_servo_itself_stood_still(cycles: int, row: int, stalled: bool) -> None:
    log = log_of_a_fault()
    log.rows["t_ns"][row:] += cycles * PERIOD_NS
    assert stalled_before_fault(log) is stalled


def test_a_run_without_a_fault_blames_nobody() -> None:
    log = log_of_a_fault()
    log.rows["fault"] = 0
    log.rows["t_ns"][100:] += 20 * PERIOD_NS
    assert not stalled_before_fault(log)


@pytest.mark.parametrize(
    ("mode", "code", "fault"),
    [
        (Mode.TRACKING, FaultCode.LAW_SLOW, ""),
        (Mode.HOLDING, FaultCode.IO_LOST, ""),
        (Mode.STOPPING, FaultCode.COLLISION, "COLLISION"),
        (Mode.FAULT, FaultCode.LAW_SLOW, "LAW_SLOW"),
    ],
)
def test_a_warning_is_no_fault(mode: Mode, code: FaultCode, fault: str) -> None:
    log = log_of_a_fault()
    log.rows["mode"][FAULT_ROW:], log.rows["fault"][FAULT_ROW:] = mode, code
    assert _result(ExperimentRun(1000), log, 1.0).fault == fault


def test_a_stop_that_somebody_asks_for_after_a_warning_is_no_fault() -> None:
    log = log_of_a_fault()
    log.rows["mode"][FAULT_ROW:], log.rows["fault"][100:] = Mode.STOPPING, FaultCode.LAW_SLOW
    assert _result(ExperimentRun(1000), log, 1.0).fault == ""


def result_with(law: str, error: float, made_again: str = "", rate_hz: int = 1000) -> Result:
    rows = log_of_a_fault().rows
    rows["q_ref"], rows["fault"] = rows["q"] + error, 0
    log = Log(Path(f"{law}.mcap"), header_for(load_robot("puma560"), PERIOD_NS, law), rows)
    return Result(
        ExperimentRun(rate_hz, "realtime", law=law), log, tracking_summary(log), 1.0, "", made_again=made_again
    )


def test_the_errors_of_the_run_that_pd_is_compared_with_are_drawn_and_those_of_pd_below(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    figures: dict[str, Figure] = {}
    monkeypatch.setattr("qrobot.log.plot.save_figure", lambda figure, path: figures.update({path.stem: figure}))
    others = result_with("qrobot", 0.2, rate_hz=4000), result_with("qrobot", 0.003), result_with("qrobot", 0.1)
    _draw([*others, result_with("pd", -0.018)], tmp_path)
    first, pd = figures["errors"].axes
    assert (first.get_title(loc="left"), pd.get_title(loc="left")) == (
        "Position tracking error, law qrobot",
        "Position tracking error, law pd",
    )
    assert [line.get_ydata()[0] for line in (first.lines[0], pd.lines[0])] == pytest.approx([0.003, -0.018])
    assert first.get_ylim() == pd.get_ylim()
    for no_pair in (["pd", "pd"], ["qrobot", "qrobot"]):
        _draw([result_with(law, 0.018 * number) for number, law in enumerate(no_pair, 1)], tmp_path)
        (alone,) = figures["errors"].axes
        assert alone.lines[0].get_ydata()[0] == pytest.approx(0.018)


def test_a_run_that_was_made_again_stays_in_what_the_demo_tells(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    results = [result_with("qrobot", 0.001, "BOARD_GONE: the board was away")]
    monkeypatch.setattr("qrobot.cli.demo._run_all", lambda *_: results)
    run_app(make_app(), ["demo", "--out-dir", str(tmp_path), "--json", str(tmp_path / "x.json")])
    assert "made again: 1000 Hz on the wall clock" in (told := capsys.readouterr().out)
    assert "at first: BOARD_GONE: the board was away" in told
    assert json.loads((tmp_path / "x.json").read_text())["runs"][0]["made_again"] == "BOARD_GONE: the board was away"


REAL_BOARDS = ('kind = "modbus", modbus = {}', 'kind = "can", can = {}', 'kind = "port", port = { base = 768 }')


@pytest.mark.parametrize("board", REAL_BOARDS)
def test_an_arm_with_a_real_board_is_moved_by_no_demo(
    board: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    demo = ["demo", "--deployment", str(write_deployment(tmp_path, board=board)), "--out-dir", str(tmp_path / "demo")]
    runs: list[ExperimentRun] = []
    monkeypatch.setattr("qrobot.cli.demo._run_all", lambda chosen, *_: runs.extend(chosen) or [])
    assert run_app(make_app(), demo) == 1
    complaint = capsys.readouterr().err
    assert "is no emulated one" in complaint
    assert complaint.count("\n") == 1
    assert runs == []
    run_app(make_app(), [*demo, "--lockstep"])
    assert {run.clock for run in runs} == {"lockstep"}


def demo_results(*errors: tuple[str, str, float], fault: str = "") -> list[Result]:
    """Lock-step runs at 1 kHz by law, plant and largest error, rad, of every joint; the last one with a `fault`."""
    log = log_of_a_fault()
    results = [
        Result(
            ExperimentRun(1000, plant=plant, law=law),
            log, replace(tracking_summary(log), max_abs_error=(error,) * 6), 1.0, "",
        )
        for law, plant, error in errors
    ]  # fmt: skip
    return [*results[:-1], replace(results[-1], fault=fault)]


def verdicts_of(results: list[Result]) -> list[tuple[bool, str]]:
    return [(verdict.holds, verdict.what) for verdict in judge(results)]


def test_verdicts_tell_each_bound_once_with_what_was_found() -> None:
    runs = ("qrobot", "nominal", 0.001), ("qrobot", "nominal", 0.0015), ("qrobot", "mismatched", 0.005)
    told = verdicts_of(demo_results(*runs[:1], *runs[2:], ("pd", "nominal", 0.003)))
    assert told == [
        (True, "no fault in 3 runs"),
        (True, "nominal plant in lock-step: joints 1-3 within 5 mrad (1.00), the others within 2 mrad (1.00)"),
        (False, "mismatched plant in lock-step: joints 1-3 within 10 mrad (5.00), the others within 4 mrad (5.00)"),
        (True, "law pd in lock-step: joints 1-3 at least 2 times as bad as law qrobot (3.0)"),
    ]
    assert verdicts_of(demo_results(*runs[:2]))[1][1].endswith("(1.50), the others within 2 mrad (1.50)")


def test_a_run_with_a_fault_fails_by_its_name() -> None:
    told = verdicts_of(demo_results(("qrobot", "nominal", 0.001), ("pd", "nominal", 0.001), fault="LAW_NAN"))
    assert (False, "lockstep-1000-nominal-pd: no fault, but LAW_NAN") in told
    assert not [what for _, what in told if "no fault in" in what]
    assert (False, "law pd in lock-step: joints 1-3 at least 2 times as bad as law qrobot (1.0)") in told


def test_a_run_on_the_wall_clock_tells_of_no_log_but_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A recorder writes over no recording: that of the run before has to go first, with all its parts."""
    run = ExperimentRun(1000, "realtime")
    header = header_for(load_robot("puma560"), PERIOD_NS, "qrobot", plant="nominal")
    old = write_log(tmp_path / f"{run.name}.mcap", make_rows(20_000), header, max_bytes=300_000)
    assert len(old) > 2
    began: list[Path] = []

    def refused(_run: ExperimentRun, _processes: Any, log: Path) -> Any:
        began.extend(part for part in tmp_path.iterdir())
        assert log == old[0]
        return nullcontext()

    monkeypatch.setattr("qrobot.rig.experiment._servo_running", refused)
    monkeypatch.setattr("qrobot.rig.experiment.time", SimpleNamespace(monotonic=lambda: 0.0))
    program = SimpleNamespace(name="program", process=SimpleNamespace(wait=lambda _patience: 0))
    processes = SimpleNamespace(start_program=lambda _path: program, rig=SimpleNamespace(end=lambda _name: None))
    with pytest.raises(LogError):  # this recorder has written nothing
        run_realtime(run, processes, tmp_path)  # type: ignore[arg-type]
    assert began == []
