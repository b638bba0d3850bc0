"""`qrobot calibrate` as a command: what it writes, what it says, and its exit status."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from qrobot.cli.arms import choose_arm
from qrobot.cli.calibrate import _Bars, _results
from qrobot.cli.console import err, out, run_app
from qrobot.cli.main import make_app
from qrobot.cli.servo_settings import calibration_of_arm
from qrobot.config import load_robot
from qrobot.config.robot import robot_path
from qrobot.servo.calibration.table import load_table, table_path
from qrobot.servo.operator.calibration_client import CalibrationReport

ROBOT = load_robot("puma560")
REPORT = CalibrationReport(False, 5, [4.2, 5, 6, 7, 8, 9], [140.0] * 6, [5, 5, 5, 4, 5, 5])


def test_a_table_made_is_one_that_can_be_loaded(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "new" / "arm.txt"
    assert run_app(make_app(), ["calibrate", "--make-table", str(path), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    table = load_table(path, ROBOT)
    assert said == {"file": str(path), "rows": [pots.size for pots in table.pots]}


REAL_BOARDS = [
    'kind = "port"\nport = { base = 0x300 }\n',
    'kind = "can"\ncan = { interface = "socketcan", channel = "can0", node_id = 1 }\n',
    'kind = "modbus"\nmodbus = { host = "192.0.2.1", port = 502 }\n',
]


@pytest.mark.parametrize("board", REAL_BOARDS)
def test_a_real_arm_does_not_get_the_table_of_an_emulated_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], board: str
) -> None:
    path, table = real_arm(tmp_path, board), tmp_path / "arm.txt"
    assert run_app(make_app(), ["calibrate", str(path), "--make-table", str(table)]) == 1
    assert "real is no emulated arm" in capsys.readouterr().err
    assert not table.exists()


def real_arm(folder: Path, board: str) -> Path:
    """A deployment file with one arm on that board."""
    path, waits = folder / "real.toml", "servo = { board_timeout_ms = 8.0 }\n"
    path.write_text(
        f'[[arm]]\nname = "real"\nrobot = "puma560"\nbridge = {{ port = 5999 }}\n{waits}[arm.board]\n{board}'
    )
    return path


@pytest.mark.parametrize("board", REAL_BOARDS)
@pytest.mark.parametrize("file", [None, "copy.txt"])
def test_a_servo_of_a_real_arm_does_not_start_with_the_table_of_an_emulated_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], board: str, file: str | None
) -> None:
    if file is not None:
        (tmp_path / file).write_text(table_path("puma560").read_text())
    path = real_arm(tmp_path, f"{board}calibration_table = '{file or 'puma560'}'\n")
    assert run_app(make_app(), ["servo", str(path)]) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "is that of an emulated arm, and real is none" in said
    assert "has to be measured on it" in said


@pytest.mark.parametrize("board", REAL_BOARDS)
def test_a_real_arm_has_a_table_that_does_not_say_whose_it_is(tmp_path: Path, board: str) -> None:
    rows = [line for line in table_path("puma560").read_text().splitlines() if not line.startswith("#")]
    (tmp_path / "measured.txt").write_text("\n".join(rows) + "\n")
    arm = choose_arm(str(real_arm(tmp_path, f"{board}calibration_table = 'measured.txt'\n")), None)
    table = calibration_of_arm(arm)
    assert table is not None
    assert (table.n, table.emulated) == (ROBOT.n, False)


def test_a_table_that_may_have_been_measured_is_not_written_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    vendors, cell = tmp_path / "PUMA.TXT", tmp_path / "cell.toml"
    make = ["calibrate", "--make-table"]
    assert run_app(make_app(), [*make, str(vendors), "--format", "vendor"]) == 0
    kept = vendors.read_bytes()
    cell.write_text("[[arm]]\n")
    capsys.readouterr()
    for path, status, told in ((vendors, 1, "PUMA.TXT does not say"), (cell, 2, "a table ends in .txt")):
        assert run_app(make_app(), [*make, str(path)]) == status
        assert told in " ".join(capsys.readouterr().err.split())
    assert (vendors.read_bytes(), cell.read_text()) == (kept, "[[arm]]\n")


@pytest.mark.thorough
def test_a_table_of_an_emulated_arm_is_made_again(tmp_path: Path) -> None:
    for _ in range(2):
        assert run_app(make_app(), ["calibrate", "--make-table", str(tmp_path / "made.txt")]) == 0


def test_a_table_that_cannot_be_written_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    assert run_app(make_app(), ["calibrate", "--make-table", str(blocked / "arm.txt")]) == 2
    assert "cannot write" in capsys.readouterr().err


@pytest.mark.sampled(1)
@pytest.mark.parametrize("degrees", [1, 5, 15])
def test_a_joint_that_meets_too_few_index_pulses_for_a_table_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], degrees: int
) -> None:
    text, table = robot_path("puma560").read_text(), tmp_path / "arm.txt"
    for old, new in (("[-160,", f"[{-degrees},"), ("[160,", f"[{degrees},"), ("end = [60,", "end = [0,")):
        text = text.replace(old, new)
    (tmp_path / "short.toml").write_text(text)
    path = tmp_path / "arms.toml"
    path.write_text('[[arm]]\nname = "short"\nrobot = "short.toml"\nbridge = { port = 5999 }\n')
    assert run_app(make_app(), ["calibrate", str(path), "--make-table", str(table)]) == 1
    assert "joint 1 meets" in capsys.readouterr().err
    assert not table.exists()


def test_without_a_servo_it_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "nobody.toml"
    path.write_text('[[arm]]\nname = "nobody_runs_this"\nrobot = "puma560"\nbridge = { port = 5999 }\n')
    assert run_app(make_app(), ["calibrate", str(path)]) == 1
    assert "nobody_runs_this" in capsys.readouterr().err


def test_a_damaged_table_keeps_the_servo_from_starting(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bad.txt").write_text("# crc32 00000000\njoint 1\n1 2\n")
    path = tmp_path / "bad.toml"
    board = f'board = {{ calibration_table = "{tmp_path / "bad.txt"}" }}'
    path.write_text(f'[[arm]]\nname = "bad_table"\nrobot = "puma560"\n{board}\nbridge = {{ port = 5999 }}\n')
    assert run_app(make_app(), ["servo", str(path)]) == 1
    said = capsys.readouterr().err
    assert "bad.txt: damaged" in said
    assert "--make-table" in said


def test_the_result_has_a_row_per_joint_with_votes_and_distances() -> None:
    with out.capture() as captured:
        out.print(_results(ROBOT, REPORT))
    lines = captured.get().splitlines()
    assert [line.split()[:3] for line in lines if line.startswith("wrist_roll")] == [["wrist_roll", "5", "4"]]
    assert sum(any(name in line for name in ROBOT.joint_names) for line in lines) == ROBOT.n
    assert "144 units" in captured.get()


def test_bars_fill_joint_after_joint() -> None:
    from qrobot.servo.memory.mailbox import CalibrationProgress

    bars = _Bars(ROBOT)
    bars.show(CalibrationProgress(2, 2, 3, 5, REPORT.misfit, REPORT.margin, REPORT.votes))  # type: ignore[arg-type]
    assert [task.completed for task in bars._progress.tasks] == [5, 5, 3, 0, 0, 0]
    assert {task.total for task in bars._progress.tasks} == {5}


def test_a_report_is_told_of_each_joint_once_and_no_terminal_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    from qrobot.servo.memory.mailbox import CalibrationProgress

    monkeypatch.setattr(err, "_force_terminal", True)
    told: list[str] = []
    with err.capture() as captured, _Bars(ROBOT, told.append) as bars:
        for joint, found in ((0, 0), (0, 3), (1, 0), (1, 5)):
            bars.show(CalibrationProgress(2, joint, found, 5, REPORT.misfit, REPORT.margin, REPORT.votes))  # type: ignore[arg-type]
    assert told == [f"{joint + 1} of 6: {ROBOT.joint_names[joint]}" for joint in (0, 1)]
    assert captured.get() == ""


def test_a_report_is_plain_json() -> None:
    assert json.loads(json.dumps(REPORT.to_dict()))["votes"] == [5, 5, 5, 4, 5, 5]
