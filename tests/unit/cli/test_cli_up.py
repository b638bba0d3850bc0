"""`qrobot up`: what it does besides starting processes, with processes that only pretend."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from qrobot.cli import up as command
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.errors import LinkLost, ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.rig.deployed import ArmProcesses
from qrobot.rig.processes import ProcessRig
from qrobot.rig.restarts import Restarts
from qrobot.servo.operator.calibration_client import ALREADY, CalibrationReport
from tests.support.patience import PATIENCE_S
from tests.support.processes import write_deployment

FOUND = CalibrationReport(False, 5, [4.0], [140.0], [5])
TABLE = 'calibration_table = "puma560"'


class Pretence:
    """Notes what is done to the arms, in order."""

    def __init__(self, patch: pytest.MonkeyPatch, report: CalibrationReport | ServoFault) -> None:
        self.done: list[str] = []
        self._report = report
        patch.setattr("qrobot.report.LAST_LINES_S", PATIENCE_S)  # the thread that writes may have no turn
        patch.setattr(ArmProcesses, "start_all", lambda _: self.done.append("start"))
        patch.setattr("qrobot.cli.calibrate.calibrate_arm", lambda *_, **__: self.calibrate())
        patch.setattr(command, "_watch", lambda *_: self.done.append("watch"))

    def calibrate(self) -> CalibrationReport:
        self.done.append("calibrate")
        if isinstance(self._report, ServoFault):
            raise self._report
        return self._report


def up(folder: Path, *words: str, board: str = TABLE) -> int:
    path = write_deployment(folder, board=board)
    return run_app(make_app("up"), ["up", str(path), "--out-dir", str(folder / "out"), *words])


@pytest.mark.parametrize(
    ("words", "key", "steps"),
    [
        ((), "", ["start", "watch"]),
        (("--calibrate",), "", ["start", "calibrate", "watch"]),
        ((), ", calibrate_at_start = true", ["start", "calibrate", "watch"]),
    ],
)
def test_an_arm_is_calibrated_once_its_processes_run_and_only_when_asked_for(
    words, key, steps, tmp_path, monkeypatch, capsys
) -> None:
    pretence = Pretence(monkeypatch, FOUND)
    assert up(tmp_path, *words, board=TABLE + key) == 0
    assert pretence.done == steps
    said = capsys.readouterr().err
    assert ("keep clear, it moves" in said) == ("calibrate" in steps)


@pytest.mark.parametrize("words", [(), ("--reduced-speed",)])
def test_reduced_speed_is_asked_of_the_servo_and_of_nobody_else(words, tmp_path, monkeypatch) -> None:
    plans = []
    monkeypatch.setattr(command, "_watch", lambda *_: None)
    monkeypatch.setattr("qrobot.rig.processes.ProcessRig.start", lambda _, *started: plans.extend(started))
    assert up(tmp_path, *words, board="") == 0
    asked = [plan.arguments[0] for plan in plans if "--reduced-speed" in plan.arguments]
    assert asked == (["servo"] if words else [])
    assert len(plans) == 5


@pytest.mark.parametrize("held_at", ["starting", "calibrating", "is up", "Ctrl-C ends", "stopping"])
def test_a_terminal_that_is_held_keeps_nobody_from_ending_the_processes(held_at, tmp_path, monkeypatch) -> None:
    pretence, free = Pretence(monkeypatch, FOUND), threading.Event()
    monkeypatch.setattr("qrobot.report.LAST_LINES_S", 0.1)

    def note(line: str) -> None:
        if held_at in line:
            assert free.wait(PATIENCE_S)

    def close(_rig: ProcessRig) -> None:
        assert not free.is_set()
        pretence.done.append("end")
        free.set()

    monkeypatch.setattr(command, "note", note)
    monkeypatch.setattr(ProcessRig, "close", close)
    assert up(tmp_path, "--calibrate") == 0
    assert pretence.done == ["start", "calibrate", "watch", "end"]


def test_an_arm_whose_board_has_kept_its_counters_is_said_to(tmp_path, monkeypatch, capsys) -> None:
    Pretence(monkeypatch, ALREADY)
    assert up(tmp_path, "--calibrate") == 0
    assert "is calibrated: its board has kept the counters" in capsys.readouterr().err


def test_a_calibration_that_is_refused_ends_everything_with_its_reason(tmp_path, monkeypatch, capsys) -> None:
    pretence = Pretence(monkeypatch, ServoFault(FaultCode.CAL_VOTE, "not calibrated: joint 2: CAL_VOTE"))
    assert up(tmp_path, "--calibrate") == 1
    assert pretence.done == ["start", "calibrate"]
    assert "CAL_VOTE" in capsys.readouterr().err


def test_a_process_that_dies_while_an_arm_calibrates_ends_everything_and_is_named(
    tmp_path, monkeypatch, capsys
) -> None:
    pretence = Pretence(monkeypatch, FOUND)

    def creep(*_: object, look: Callable[[], None], **__: object) -> CalibrationReport:
        look()
        return pretence.calibrate()

    def lose_the_board(_: Restarts) -> None:
        raise LinkLost("puma560-board has ended: no supply")

    monkeypatch.setattr("qrobot.cli.calibrate.calibrate_arm", creep)
    monkeypatch.setattr(Restarts, "look", lose_the_board)
    assert up(tmp_path, "--calibrate") == 1
    assert pretence.done == ["start"]
    assert "board has ended: no supply" in capsys.readouterr().err


def test_to_be_calibrated_at_start_an_arm_needs_a_table(tmp_path, capsys) -> None:
    assert up(tmp_path, board="calibrate_at_start = true") == 1
    assert "calibrate_at_start needs a calibration_table" in capsys.readouterr().err
