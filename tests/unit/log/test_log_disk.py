"""A disk that is full or slow never disturbs the servo: what it costs is counted, told, and bounded."""

from __future__ import annotations

import hashlib
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.log.follow import POLL_S
from qrobot.log.header import header_for
from qrobot.log.read import read_log
from qrobot.log.record import FLUSH_NS, LogRecorder
from qrobot.log.writer import LogWriter
from qrobot.rig.experiment import program_path, run_program
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.memory.law_history import LawInForce
from qrobot.servo.memory.servo_memory import create_servo_memory, servo_info
from qrobot.servo.memory.telemetry import TelemetryLayout, TelemetryReader, append_row
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.log_samples import FullDisk, Ring, make_header, make_rows
from tests.support.patience import PATIENCE_S, wait_until

MOST_LOST_NS = 250_000_000  # what a kill -9 may cost
FILE_LIMIT = 1_000_000
ROBOT = load_robot("puma560")


class RecordedRig(LockstepRig):
    """A rig whose recorder looks at the ring after every turn of the servo, as a process beside it would."""

    recorder: LogRecorder | None = None

    def ticks(self, n: int) -> None:
        """Advance, and let the recorder look."""
        super().ticks(n)
        if self.recorder is not None:
            self.recorder.poll(self.now_ns)


def experiment(recorded_in: Path | None) -> RecordedRig:
    """The paper's experiment in lock-step, with a recorder on the ring if a file is given."""
    rig = RecordedRig(ROBOT, ServoSettings(rate_hz=1000), Emulator(ROBOT, physics="rigid"))
    if recorded_in is not None:
        info = rig.mailbox.info
        reader = TelemetryReader(rig.mailbox.words, info.telemetry_base, info.telemetry_capacity, ROBOT.n)
        rig.recorder = LogRecorder(reader, LogWriter(recorded_in, header_for(ROBOT, rig.period_ns, "qrobot")))
    run_program(rig, program_path())
    return rig


def digest(rig: LockstepRig) -> str:
    return hashlib.sha256(rig.rows().tobytes()).hexdigest()


def test_the_motion_is_the_same_to_the_last_bit_while_the_disk_refuses_every_byte(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    undisturbed = experiment(None)
    monkeypatch.setattr("qrobot.log.record.BACKLOG_BYTES", 100_000)
    disk = FullDisk(monkeypatch, room=20_000)
    rig = experiment(tmp_path / "run.mcap")
    assert digest(rig) == digest(undisturbed)
    assert rig.recorder is not None
    assert rig.recorder.status.disk_errors > 0
    disk.room = 10**9
    rig.recorder.close()
    log = read_log(tmp_path / "run.mcap")
    assert log.status.lost > 0
    assert log.rows.size + log.status.lost == rig.rows().size


def of_little_memory(path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Ring, LogRecorder]:
    """A ring, and its recorder, which keeps 50 kB for a disk that is full."""
    monkeypatch.setattr("qrobot.log.record.BACKLOG_BYTES", 50_000)
    ring = Ring(1024)
    return ring, LogRecorder(ring.reader(), LogWriter(path, make_header()))


def test_rows_that_a_full_disk_leaves_in_the_ring_at_the_end_are_counted_as_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ring, recorder = of_little_memory(tmp_path / "run.mcap", monkeypatch)
    FullDisk(monkeypatch, room=0)
    for i in range(5):
        ring.append(make_rows(500, first=500 * i))
        recorder.poll(i * FLUSH_NS)
    recorder.close()
    assert recorder.status.rows < 2500
    assert recorder.status.rows + recorder.status.lost == 2500
    assert recorder.backlog > 50_000  # what the disk never took


def test_memory_does_not_grow_while_a_disk_stays_full_over_hours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ring, recorder = of_little_memory(tmp_path / "run.mcap", monkeypatch)
    disk = FullDisk(monkeypatch, room=0)
    polls = iter(range(100_000))

    def go_on(times: int) -> int:
        for i in range(times):
            ring.append(make_rows(4, first=4 * i))
            recorder.poll(next(polls) * FLUSH_NS)
        return recorder.backlog

    assert 50_000 < go_on(1000) == go_on(1000) < 100_000
    disk.room = 10**9
    recorder.poll(next(polls) * FLUSH_NS)
    assert recorder.backlog == 0


class TalkingJournal:
    """A journal beside a servo that runs: a row is written whenever it is read."""

    def __init__(self, ring: Ring) -> None:
        self._ring = ring

    def read(self) -> list[LawInForce]:
        self._ring.append(make_rows(1, first=10))
        return []


def test_rows_that_a_servo_writes_while_its_recorder_stops_are_not_lost_to_it(tmp_path: Path) -> None:
    ring = Ring(1024)
    journal: Any = TalkingJournal(ring)
    recorder = LogRecorder(ring.reader(), LogWriter(tmp_path / "run.mcap", make_header()), journal)
    ring.append(make_rows(10))
    recorder.close()
    assert (recorder.status.rows, recorder.status.lost) == (10, 0)


def test_what_a_slow_disk_makes_the_ring_overwrite_is_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ring, write, went_on = Ring(256), os.write, iter(range(100, 100_000, 400))

    def slow(fd: int, data: Any) -> int:
        ring.append(make_rows(400, first=next(went_on)))  # so many cycles run while the disk thinks
        return write(fd, data)

    recorder = LogRecorder(ring.reader(), LogWriter(tmp_path / "run.mcap", make_header()))
    ring.append(make_rows(100))
    monkeypatch.setattr(os, "write", slow)
    for i in range(10):
        recorder.poll(i * FLUSH_NS)
    monkeypatch.undo()
    recorder.close()
    log = read_log(tmp_path / "run.mcap")
    assert log.status.lost > 0
    assert log.rows.size + log.status.lost == next(went_on)
    assert np.all(np.diff(log.rows["tick"]) > 0)


def test_at_every_moment_the_file_holds_all_but_the_last_250_ms(tmp_path: Path) -> None:
    ring, path, now_ns = Ring(8192), tmp_path / "run.mcap", 0
    recorder = LogRecorder(ring.reader(), LogWriter(path, make_header()))
    for turn in range(100):
        ring.append(make_rows(40, first=40 * turn))  # 10 ms at 4 kHz
        now_ns += round(POLL_S * 1e9)
        recorder.poll(now_ns)
        written = read_log(path).rows.size  # what a kill -9 here would leave
        assert (40 * (turn + 1) - written) * 250_000 <= MOST_LOST_NS
    assert written > 3000


DEPLOYMENT = '[[arm]]\nname = "{arm}"\nrobot = "puma560"\nbridge = {{ port = 5998 }}\n'


def size_of(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


@pytest.mark.realtime
def test_a_recorder_whose_file_may_not_grow_says_so_lives_on_and_keeps_what_it_has(tmp_path: Path) -> None:
    arm, target = f"disk{os.getpid()}", tmp_path / "run.mcap"
    (tmp_path / "lab.toml").write_text(DEPLOYMENT.format(arm=arm))
    row_words = TelemetryLayout(6).row_words
    with create_servo_memory(arm, "puma560", "pd", 6, 250_000, 4096) as memory:
        memory.front.info.ready = 1
        base = servo_info(memory.words).telemetry_base
        recorder = subprocess.Popen(
            [sys.executable, "-m", "qrobot", "log", "record", str(tmp_path / "lab.toml"), "--output", str(target)],
            stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE, (FILE_LIMIT, FILE_LIMIT))
        try:
            first, deadline = 0, time.monotonic() + PATIENCE_S
            while time.monotonic() < deadline and (size := size_of(target)) < FILE_LIMIT:
                for row in make_rows(200, first=first).view(np.int64).reshape(200, row_words):
                    append_row(memory.words, base, 4096, row_words, row)
                first += 200
                wait_until(lambda size=size: size_of(target) > size, "the recorder has read some rows")
            time.sleep(1.0)
            assert recorder.poll() is None
        finally:
            recorder.send_signal(signal.SIGTERM)
            try:
                said = recorder.communicate(timeout=PATIENCE_S)[1]
            finally:
                recorder.kill()  # one that hangs fails the test, and is not left behind
    assert recorder.returncode == 0, said
    assert "refusals by the disk (File too large)" in said
    assert "the disk did not take its last" in said
    log = read_log(target)
    assert log.torn
    assert log.rows.size > 100
    assert np.all(np.diff(log.rows["tick"]) == 1)
