"""`qrobot log`: what it prints and writes."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from qrobot.cli.console import run_app
from qrobot.cli.log import FigureName
from qrobot.cli.main import make_app
from qrobot.config import load_robot
from qrobot.faultcodes import FaultCode
from qrobot.log.follow import LOOK_NS, ServoFollower
from qrobot.log.header import Attachment, header_for
from qrobot.log.plot import FIGURES
from qrobot.log.read import read_log
from qrobot.log.record import write_log
from qrobot.log.writer import LogWriter
from qrobot.realtime.setup import SetupStep
from qrobot.realtime.shared_memory import segment_path
from qrobot.servo.memory.servo_memory import create_servo_memory, servo_info
from qrobot.servo.memory.telemetry import TelemetryLayout, append_row
from tests.support.log_samples import FullDisk, make_header, make_rows
from tests.support.patience import PATIENCE_S, wait_until


@pytest.fixture
def log_file(tmp_path: Path) -> Path:
    rows = make_rows(400)
    rows["q"] = rows["q_ref"] - 2e-3
    rows["fault"][300:] = 66
    setup = (SetupStep("scheduler", False, "SCHED_OTHER 0", "run as root"),)
    header = replace(make_header(), law="pd", setup=setup)
    write_log(tmp_path / "run.mcap", rows, header, [Attachment("robot.toml", b"")])
    return tmp_path / "run.mcap"


def test_info_as_json_has_the_numbers_of_the_log(log_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_app(make_app(), ["log", "info", str(log_file), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["rate_hz"] == 4000.0
    assert facts["cycles"] == facts["tracking_cycles"] == 400
    assert facts["max_abs_error"] == pytest.approx([2e-3] * 6)
    assert facts["joint_units"] == ["rad"] * 6
    assert facts["duration_s"] == pytest.approx(399 / 4000)
    assert facts["complete"] is True
    assert facts["faults"][0].startswith("FOLLOWING:")
    assert facts["setup"][0]["name"] == "scheduler"
    assert facts["attachments"] == ["robot.toml"]


ROWS = 300


def damaged(path: Path) -> Path:
    """The same log with eight bytes of its first chunk wrong."""
    data = bytearray(path.read_bytes())
    at = data.index(b"\x04\x00\x00\x00zstd") + 200
    data[at : at + 8] = bytes(byte ^ 0xFF for byte in data[at : at + 8])
    path.write_bytes(data)
    return path


@pytest.fixture
def damaged_file(tmp_path: Path) -> Path:
    writer = LogWriter(tmp_path / "damaged.mcap", make_header())
    for k in range(4):
        writer.append(make_rows(ROWS, first=k * ROWS))
        writer.flush()
    writer.close()
    return damaged(tmp_path / "damaged.mcap")


@pytest.mark.parametrize(
    "words",
    [
        ["info", "{log}"],
        ["info", "{log}", "--json"],
        ["events", "{log}"],
        ["plot", "{log}", "--only", "errors"],
        ["export", "{log}", "{folder}/x.csv"],
        ["compare", "{log}", "{log}"],
    ],
    ids=lambda words: " ".join(words[:1] + words[2:]),
)
def test_every_command_reads_what_is_whole_of_a_damaged_log_and_tells_what_is_lost(
    words: list[str], damaged_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    places = {"log": damaged_file, "folder": tmp_path}
    assert run_app(make_app(), ["log", *(word.format(**places) for word in words)]) == 0
    assert f"is damaged: {ROWS} cycles from" in capsys.readouterr().err


def test_info_of_a_damaged_log_says_that_it_is_not_complete(
    damaged_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_app(make_app(), ["log", "info", str(damaged_file), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["complete"], facts["cycles"]) == (False, 3 * ROWS)
    assert [lost["cycles"] for lost in facts["lost_to_damage"]] == [ROWS]


def test_info_of_a_log_that_is_being_written_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    writer = LogWriter(tmp_path / "now.mcap", make_header())
    writer.append(make_rows(100))
    writer.flush()
    words = ["log", "info", str(writer.path)]
    assert run_app(make_app(), words) == 0
    assert "complete not yet: its recorder still writes it" in " ".join(capsys.readouterr().out.split())
    assert run_app(make_app(), [*words, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["complete"], facts["being_written"], facts["cycles"]) == (False, True, 100)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(writer.path.read_bytes())
    assert run_app(make_app(), ["log", "info", str(cut)]) == 0
    assert "complete no: it breaks off, as where its recorder was killed" in " ".join(capsys.readouterr().out.split())
    writer.close()
    assert run_app(make_app(), words) == 0
    assert "complete yes" in " ".join(capsys.readouterr().out.split())


def test_a_log_of_which_nothing_is_left_is_a_failure(log_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_app(make_app(), ["log", "info", str(damaged(log_file))]) == 1
    assert "is damaged, and no cycle can be read" in capsys.readouterr().err


def test_info_tells_of_several_logs_and_of_a_rotated_one_once(
    log_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parts = write_log(tmp_path / "long.mcap", make_rows(30_000), make_header(), max_bytes=500_000)
    assert len(parts) > 2
    assert run_app(make_app(), ["log", "info", str(log_file), *map(str, parts)]) == 0
    told = capsys.readouterr().out
    assert told.count("rate hz") == 2
    assert run_app(make_app(), ["log", "info", str(log_file), *map(str, parts), "--json"]) == 0
    assert [facts["cycles"] for facts in json.loads(capsys.readouterr().out)] == [400, 30_000]
    assert run_app(make_app(), ["log", "info"]) == 1


@pytest.mark.parametrize("at", [0, 1, 2])
def test_info_of_several_logs_tells_those_that_can_be_read(
    at: int, log_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (bad := tmp_path / "bad.mcap").write_bytes(b"no log")
    write_log(tmp_path / "other.mcap", make_rows(500), make_header())
    files = [str(log_file), str(tmp_path / "other.mcap")]
    files.insert(at, str(bad))
    assert run_app(make_app(), ["log", "info", *files]) == 1
    told = capsys.readouterr()
    assert told.out.count("rate hz") == 2
    assert "1 of 3 logs cannot be read: " in told.err
    assert str(bad) in told.err.replace("\n", "")
    assert run_app(make_app(), ["log", "info", *files, "--json"]) == 1
    facts = json.loads(capsys.readouterr().out)
    assert [each.get("cycles") for each in facts if "error" not in each] == [400, 500]
    assert facts[at]["files"] == [str(bad)]
    assert str(bad) in facts[at]["error"]


def test_info_for_people_says_the_same_in_a_table(log_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_app(make_app(), ["log", "info", str(log_file)]) == 0
    text = " ".join(capsys.readouterr().out.split())
    for words in ("robot sample", "cycles 400", "complete yes", "FOLLOWING", "scheduler: SCHED_OTHER 0 (refused)"):
        assert words in text


def test_plot_writes_the_figures_asked_for_beside_the_log(log_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_app(make_app(), ["log", "plot", str(log_file), "--only", "errors"]) == 0
    figure = log_file.with_name("run-errors.png")
    assert figure.is_file()
    assert figure.name in capsys.readouterr().out.replace("\n", "")
    assert not log_file.with_name("run-torques.png").exists()


def test_several_logs_are_drawn_each_beside_itself(log_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = log_file.with_name("other.mcap")
    other.write_bytes(log_file.read_bytes())
    assert run_app(make_app(), ["log", "plot", str(log_file), str(other), "--only", "errors"]) == 0
    assert log_file.with_name("run-errors.png").is_file()
    assert log_file.with_name("other-errors.png").is_file()
    assert len(capsys.readouterr().out.splitlines()) == 2


def test_figures_of_two_logs_of_one_name_do_not_replace_each_other(
    log_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other" / log_file.name
    other.parent.mkdir()
    other.write_bytes(log_file.read_bytes())
    words = ["log", "plot", str(log_file), str(other), "--only", "errors"]
    assert run_app(make_app(), [*words, "--output", str(tmp_path)]) == 1
    assert "two of these logs have one name" in " ".join(capsys.readouterr().err.split())
    assert run_app(make_app(), words) == 0
    assert other.with_name(f"{other.stem}-errors.png").is_file()


def test_signals_of_a_log_that_has_none_are_not_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_log(tmp_path / "run.mcap", make_rows(30), make_header())
    assert run_app(make_app(), ["log", "plot", str(tmp_path / "run.mcap"), "--only", "signals"]) == 1
    assert "neither its law nor a program has named a signal" in " ".join(capsys.readouterr().err.split())
    assert list(tmp_path.glob("*.png")) == []


def test_faults_of_a_log_are_told_a_line_each_in_the_order_of_time(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = make_rows(300)
    rows["fault"][100:200], rows["fault"][200:] = FaultCode.ESTOP, FaultCode.ENC_STUCK
    write_log(tmp_path / "run.mcap", rows, make_header())
    assert run_app(make_app(), ["log", "info", str(tmp_path / "run.mcap"), "--json"]) == 0
    faults = json.loads(capsys.readouterr().out)["faults"]
    assert [line.partition(":")[0] for line in faults] == ["ESTOP", "ENC_STUCK"]
    assert run_app(make_app(), ["log", "info", str(tmp_path / "run.mcap")]) == 0
    lines = [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert faults[1] in lines


def test_the_command_offers_every_figure_there_is() -> None:
    assert set(get_args(FigureName)) == set(FIGURES)


def test_export_chooses_the_format_by_suffix(log_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = log_file.with_suffix(".csv")
    assert run_app(make_app(), ["log", "export", str(log_file), str(target)]) == 0
    assert len(target.read_text().splitlines()) == 401
    assert run_app(make_app(), ["log", "export", str(log_file), "run.xls"]) == 2
    assert "a table ends in .csv or .parquet" in capsys.readouterr().err


def test_a_recorder_writes_over_no_recording(log_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = log_file.read_bytes()
    assert run_app(make_app(), ["log", "record", "--output", str(log_file)]) == 2
    assert "it is a recording already, name another file" in " ".join(capsys.readouterr().err.split())
    assert log_file.read_bytes() == before


@pytest.mark.parametrize("command", [["info"], ["plot"], ["export"]])
def test_a_missing_log_is_one_line_and_status_1(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    target = ["x.csv"] if command == ["export"] else []
    assert run_app(make_app(), ["log", *command, "absent.mcap", *target]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "absent.mcap" in error


def test_a_robots_header_knows_its_joints() -> None:
    robot = load_robot("stanford")
    header = header_for(robot, 500_000, "pd", plant="nominal")
    assert header.joint_names == robot.joint_names
    assert header.prismatic == tuple(robot.prismatic.tolist())
    assert True in header.prismatic
    assert header.version


DEPLOYMENT = """
[[arm]]
name = "{arm}"
robot = "puma560"
[arm.bridge]
port = 5999
"""


@pytest.mark.realtime
def test_record_writes_down_a_running_servo_and_ends_on_sigterm(tmp_path: Path) -> None:
    arm = f"rec{os.getpid()}"
    (tmp_path / "lab.toml").write_text(DEPLOYMENT.format(arm=arm))
    rows, row_words = make_rows(3000), TelemetryLayout(6).row_words
    with create_servo_memory(arm, "puma560", "pd", 6, 250_000, 4096) as memory:
        memory.front.info.ready = 1
        base = servo_info(memory.words).telemetry_base
        for row in rows.view(np.int64).reshape(3000, row_words):
            append_row(memory.words, base, 4096, row_words, row)
        (tmp_path / "logs").mkdir()
        old = tmp_path / "logs" / f"{arm}-20250101T000000Z.mcap"
        old.write_bytes(bytes(10_000_000))
        command = [sys.executable, "-m", "qrobot", "log", "record", str(tmp_path / "lab.toml"), "--keep-gb", "0.01"]
        recorder = subprocess.Popen(
            [*command, "--output", str(tmp_path / "logs" / "run.mcap"), "--plant", "mismatched"],
            stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        try:
            assert wait_for(tmp_path / "logs" / "run.mcap", 1000)
        finally:
            recorder.send_signal(signal.SIGTERM)
            said = recorder.communicate(timeout=PATIENCE_S)[1]
    assert recorder.returncode == 0, said
    assert f"the servo of {arm} is recorded in " in said
    assert f"the oldest, {old.name}, are removed" in said
    assert not old.exists()
    log = read_log(tmp_path / "logs" / "run.mcap")
    np.testing.assert_array_equal(log.rows, rows)
    assert not log.torn
    assert (log.header.robot, log.header.plant, log.header.law) == ("puma560", "mismatched", "pd")
    assert set(log.attachments) == {"puma560.toml", "lab.toml"}
    assert {"scheduler", "memory", "kernel"} <= {step.name for step in log.header.setup}
    assert abs(log.header.wall_offset_ns - (time.time_ns() - time.monotonic_ns())) < 10**9
    assert not segment_path(f"{arm}-servo").exists()


def test_record_outlives_a_full_disk_and_what_it_says_of_it_on_that_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arm = f"full{os.getpid()}"
    (tmp_path / "lab.toml").write_text(DEPLOYMENT.format(arm=arm))
    said: list[str] = []

    def note(line: str) -> None:
        said.append(line)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def pretend(follower: ServoFollower, _stop: threading.Event) -> None:
        """The recorder beside a servo, on a clock moved by hand."""
        disk = FullDisk(monkeypatch, room=10**9)
        for turn in range(40):
            disk.room = 0 if 5 <= turn < 30 else 10**9
            for row in make_rows(200, first=200 * turn).view(np.int64).reshape(200, row_words):
                append_row(memory.words, base, 1024, row_words, row)
            follower.step(turn * LOOK_NS)
        follower.close()

    monkeypatch.setattr("qrobot.log.record.BACKLOG_BYTES", 50_000)
    monkeypatch.setattr("qrobot.log.follow.follow", pretend)
    monkeypatch.setattr("qrobot.cli.log.note", note)
    monkeypatch.setattr("qrobot.cli.log.recorded_header", lambda *_: make_header())
    with create_servo_memory(arm, "puma560", "pd", 6, 250_000, 1024) as memory:
        memory.front.info.ready = 1
        base, row_words = servo_info(memory.words).telemetry_base, TelemetryLayout(6).row_words
        command = ["log", "record", str(tmp_path / "lab.toml"), "--output", str(tmp_path / "run.mcap")]
        assert run_app(make_app("log"), command) == 0
    log = read_log(tmp_path / "run.mcap")
    assert log.status.lost > 0
    assert log.rows.size + log.status.lost == 8000
    assert log.rows["tick"][-1] == 7999
    wait_until(lambda: any("refusals by the disk" in line for line in said), "the line about the disk")


def wait_for(path: Path, size: int, patience_s: float = PATIENCE_S) -> bool:
    """True when `path` reaches `size` bytes in time."""
    deadline = time.monotonic() + patience_s
    while time.monotonic() < deadline:
        if path.exists() and path.stat().st_size >= size:
            return True
        time.sleep(0.05)
    return False


REAL_BOARD = "board = { kind = 'port', port = { base = 0x300 } }\nservo = { board_timeout_ms = 8.0 }\n"


@pytest.mark.parametrize(
    ("more", "plant", "told"),
    [
        (REAL_BOARD, "nominal", "is a real arm, whose log tells of none"),
        ("", "", "is an emulated arm, whose log names one"),
    ],
)
def test_a_plant_that_would_make_a_real_arm_of_an_emulated_one_or_the_other_way_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], more: str, plant: str, told: str
) -> None:
    path = tmp_path / "cell.toml"
    path.write_text(f"[[arm]]\nname = 'one'\nrobot = 'puma560'\nbridge = {{ port = 5999 }}\n{more}")
    assert run_app(make_app(), ["log", "record", str(path), "--output", str(tmp_path), "--plant", plant]) == 1
    assert f"--plant '{plant}': one {told}" in " ".join(capsys.readouterr().err.split())
