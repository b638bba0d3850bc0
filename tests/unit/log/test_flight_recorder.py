"""The seconds around an incident become a log of their own, whatever the disk says."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import numpy as np
import pytest

from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.config import load_robot
from qrobot.errors import LogError
from qrobot.faultcodes import FaultCode
from qrobot.log.flight import AFTER_NS, ATTACHMENT, BEFORE_NS, FlightRecorder, incidents_of
from qrobot.log.header import Attachment, header_for
from qrobot.log.read import read_log
from qrobot.log.record import write_log
from qrobot.modecodes import Mode
from qrobot.realtime.structure import local_record
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.published_state import publish_state, state_dtype
from qrobot.servo.memory.servo_memory import ServoInfo, local_servo_memory
from qrobot.servo.memory.stop_record import Incident
from qrobot.servo.memory.telemetry import TelemetryLayout, append_row

ROBOT = load_robot("puma560")
PERIOD_NS = 1_000_000
START_NS = 10_000_000_000
RUNAWAY = int(FaultCode.RUNAWAY)


class Servo:
    """A servo's memory, a cycle a millisecond, and a flight recorder that looks at it every 50."""

    def __init__(self, folder: Path, keep: int = 20) -> None:
        self.words = local_servo_memory(ROBOT.name, "qrobot", ROBOT.n, PERIOD_NS, 1 << 14)
        self.mailbox = ServoMailbox(self.words)
        self.said: list[str] = []
        self.recorder = FlightRecorder(folder, "left", self._header, self.said.append, keep)
        self.incident: Incident | None = None
        self.now_ns = START_NS
        self._row = np.zeros(TelemetryLayout(ROBOT.n).row_words, dtype=np.int64)
        self._state = local_record(state_dtype(ROBOT.n))

    def _header(self, info: ServoInfo) -> object:
        return header_for(ROBOT, info.period_ns, info.law)

    def run(self, seconds: float) -> None:
        info = self.mailbox.info
        for cycle in range(round(seconds * 1e9 / PERIOD_NS)):
            self.now_ns += PERIOD_NS
            self._row[0] += 1
            self._row[1] = self._state.t_ns = self.now_ns
            append_row(self.words, info.telemetry_base, info.telemetry_capacity, self._row.size, self._row)
            publish_state(self.mailbox.memory, self._state)
            if cycle % 50 == 0:
                self.recorder.look(self.mailbox, self.incident)

    def happen(self, code: int = RUNAWAY, to: Mode = Mode.FAULT) -> Incident:
        number = 1 if self.incident is None else self.incident.number + 1
        self.incident = Incident(number, self.now_ns, 7, code, 2, 4.51, 4.1, int(Mode.TRACKING), int(to), 3)
        return self.incident


def files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.mcap"))


def test_nothing_is_saved_before_the_time_after_an_incident_is_over(tmp_path: Path) -> None:
    servo = Servo(tmp_path / "incidents")
    servo.run(3.0)
    servo.happen()
    servo.run(0.45)
    assert servo.said == []
    servo.run(0.15)
    assert len(files(tmp_path / "incidents")) == len(servo.said) == 1


def test_the_file_has_the_cycles_around_the_incident_and_the_incident(tmp_path: Path) -> None:
    servo = Servo(tmp_path)
    servo.run(BEFORE_NS * 1e-9 + 1.0)
    happened = servo.happen()
    servo.run(1.0)
    [path] = files(tmp_path)
    assert path.name.startswith("left-RUNAWAY-")
    assert str(path) in servo.said[0]
    log = read_log(path)
    assert not log.torn
    assert incidents_of(log) == [happened]
    t_ns = log.rows["t_ns"]
    assert t_ns[0] == happened.t_ns - BEFORE_NS
    assert 0 <= t_ns[-1] - (happened.t_ns + AFTER_NS) <= 50 * PERIOD_NS
    assert np.all(np.diff(t_ns) == PERIOD_NS)


def test_a_second_incident_soon_after_goes_into_the_same_file_under_its_own_name(tmp_path: Path) -> None:
    servo = Servo(tmp_path)
    servo.run(1.0)
    first = servo.happen(int(FaultCode.COLLISION), Mode.STOPPING)
    servo.run(0.2)
    second = servo.happen(int(FaultCode.DAC_STUCK))
    servo.run(1.0)
    [path] = files(tmp_path)
    assert path.name.startswith("left-DAC_STUCK-")
    assert incidents_of(read_log(path)) == [first, second]


def test_incidents_without_end_are_saved_in_time(tmp_path: Path) -> None:
    servo = Servo(tmp_path)
    for _ in range(24):
        servo.happen()
        servo.run(0.1)
    assert len(files(tmp_path)) == 1


def test_the_newest_files_are_kept(tmp_path: Path) -> None:
    servo = Servo(tmp_path, keep=2)
    kept = []
    for age in (3, 2, 1, 0):
        servo.happen()
        servo.run(0.6)
        newest = max(files(tmp_path), key=lambda path: path.stat().st_mtime_ns)
        os.utime(newest, (1e9 - age, 1e9 - age))
        kept.append(newest)
    assert files(tmp_path) == sorted(kept[-2:])


@pytest.mark.parametrize("keep", [1, 2])
def test_a_file_is_kept_when_those_before_it_are_from_a_clock_that_was_ahead(tmp_path: Path, keep: int) -> None:
    servo = Servo(tmp_path, keep=keep)
    for hour in (1, 2):
        servo.happen()
        servo.run(0.6)
        newest = min(files(tmp_path), key=lambda path: path.stat().st_mtime_ns)
        os.utime(newest, (4e9 + hour, 4e9 + hour))
    servo.happen()
    servo.run(0.6)
    path = Path(servo.said[-1].split("`")[1].removeprefix("qrobot log info "))
    assert path.exists()
    assert len(files(tmp_path)) == keep


def test_a_servo_that_ends_saves_what_there_is(tmp_path: Path) -> None:
    servo = Servo(tmp_path)
    servo.run(0.3)
    servo.happen()
    servo.recorder.look(servo.mailbox, servo.incident, ended=True)
    assert len(files(tmp_path)) == 1
    assert read_log(files(tmp_path)[0]).rows.size == 300


def test_a_disk_that_refuses_is_told_of_and_costs_that_file_alone(tmp_path: Path) -> None:
    blocked = tmp_path / "incidents"
    blocked.write_text("a file where the folder should be")
    servo = Servo(blocked)
    servo.happen()
    servo.run(0.6)
    assert "RUNAWAY are not saved" in servo.said[0]
    blocked.unlink()
    servo.happen()
    servo.run(0.6)
    assert len(files(blocked)) == 1


def test_a_look_while_the_loop_is_interrupted_in_its_writing_is_made_up_for_by_the_next(tmp_path: Path) -> None:
    servo = Servo(tmp_path)
    servo.happen()
    servo.run(0.45)
    published = servo.mailbox.memory.published
    published.sequence += 1  # odd: a state is being written
    servo.recorder.look(servo.mailbox, servo.incident)
    published.sequence += 1
    servo.run(0.15)
    assert len(files(tmp_path)) == 1


def test_log_info_tells_what_a_file_was_saved_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    servo = Servo(tmp_path)
    servo.happen()
    servo.run(0.6)
    [path] = files(tmp_path)
    assert run_app(make_app(), ["log", "info", str(path), "--json"]) == 0
    [told] = json.loads(capsys.readouterr().out)["incidents"]
    assert (told["name"], told["value"], told["limit"]) == ("RUNAWAY", 4.51, 4.1)
    assert run_app(make_app(), ["log", "info", str(path)]) == 0
    assert "TRACKING -> FAULT: joint 3: 4.51 rad/s, limit 4.1 rad/s; RUNAWAY" in " ".join(
        capsys.readouterr().out.split()
    )


def test_an_incident_of_a_later_version_is_told_by_its_number(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    header, incident = header_for(ROBOT, PERIOD_NS, "qrobot"), Incident(1, 5, 7, 999, 2, math.nan, 4.1, 3, 6, 3)
    told = json.dumps([incident.to_dict()]).encode()
    write_log(tmp_path / "x.mcap", header.layout.empty(0), header, [Attachment(ATTACHMENT, told)])
    assert run_app(make_app(), ["log", "info", str(tmp_path / "x.mcap"), "--json"]) == 0
    [told] = json.loads(capsys.readouterr().out, parse_constant=refuse_constant)["incidents"]
    assert (told["name"], told["code"], told["value"]) == ("fault 999", 999, None)


def refuse_constant(name: str) -> None:
    raise AssertionError(f"{name} is no JSON")


@pytest.mark.parametrize("damage", [b"{", b"[{}]", b"[1]", b"[" * 100_000])
def test_a_damaged_incident_is_told(tmp_path: Path, damage: bytes) -> None:
    header = header_for(ROBOT, PERIOD_NS, "qrobot")
    write_log(tmp_path / "x.mcap", header.layout.empty(0), header, [Attachment(ATTACHMENT, damage)])
    with pytest.raises(LogError, match="is damaged"):
        incidents_of(read_log(tmp_path / "x.mcap"))
