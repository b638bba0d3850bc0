"""The recorder follows the servos of an arm: a log for each, and no cycle of a dead one is left behind."""

from __future__ import annotations

import os
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from qrobot.log.follow import LOOK_NS, ServoFollower, fresh_path, log_paths
from qrobot.log.read import Log, read_log
from qrobot.log.writer import LogWriter
from qrobot.realtime.shared_memory import segment_path
from qrobot.servo.memory.servo_memory import ServoInfo, create_servo_memory, servo_info
from qrobot.servo.memory.telemetry import Rows, TelemetryLayout, append_row
from tests.support.log_samples import PERIOD_NS, make_header, make_rows

N = 3
CAPACITY = 256


class FakeServo:
    """The memory of a servo, filled by hand."""

    def __init__(self, arm: str) -> None:
        self.segment = create_servo_memory(arm, "sample", "pd", N, PERIOD_NS, CAPACITY)
        self.segment.front.info.ready = 1

    def cycles(self, rows: Rows) -> None:
        info, row_words = servo_info(self.segment.words), TelemetryLayout(N).row_words
        for row in rows.view(np.int64).reshape(rows.size, row_words):
            append_row(self.segment.words, info.telemetry_base, CAPACITY, row_words, row)

    def die(self) -> None:
        """As after kill -9: the lock is gone, the memory stays."""
        self.segment.close()

    def end(self) -> None:
        """As after SIGTERM: the memory is removed."""
        self.segment.close(unlink=True)


class Bench:
    """A follower on a clock moved by hand."""

    def __init__(self, arm: str, directory: Path) -> None:
        self.arm, self.now_ns = arm, 0
        self.lines: list[str] = []
        self.opened: list[tuple[ServoInfo, int]] = []
        self.paths = [directory / f"{k}.mcap" for k in range(9)]
        self.follower = ServoFollower(arm, self.open_log, self.lines.append)

    def open_log(self, info: ServoInfo, pid: int) -> LogWriter:
        self.opened.append((info, pid))
        return LogWriter(self.paths[len(self.opened) - 1], make_header(info.n, info.period_ns))

    def step(self) -> None:
        self.now_ns += LOOK_NS
        self.follower.step(self.now_ns)

    def log(self, k: int) -> Log:
        return read_log(self.paths[k])


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    arm = f"follow{os.getpid()}"
    bench = Bench(arm, tmp_path)
    yield bench
    bench.follower.close()
    segment_path(f"{arm}-servo").unlink(missing_ok=True)


def test_it_waits_for_a_servo_and_records_it_from_its_first_cycle(bench: Bench) -> None:
    bench.step()
    assert not bench.follower.recording
    servo, rows = FakeServo(bench.arm), make_rows(100, N)
    servo.cycles(rows[:60])
    bench.step()
    bench.step()
    servo.cycles(rows[60:])
    bench.follower.close()
    np.testing.assert_array_equal(bench.log(0).rows, rows)
    info, pid = bench.opened[0]
    assert (info.robot_name, info.law, pid) == ("sample", "pd", os.getpid())
    servo.end()


def test_a_servo_that_runs_other_code_is_told_of_once(bench: Bench) -> None:
    servo = FakeServo(bench.arm)
    servo.segment.header.digest += 1
    bench.step()
    bench.step()
    assert not bench.follower.recording
    (line,) = bench.lines
    assert line.startswith(f"the servo of {bench.arm} is not recorded")
    assert line.endswith("its owner runs other code; restart both")
    servo.end()


def test_a_servo_that_is_still_starting_is_waited_for(bench: Bench) -> None:
    servo = FakeServo(bench.arm)
    servo.segment.front.info.ready = 0
    bench.step()
    assert not bench.follower.recording
    servo.segment.front.info.ready = 1
    bench.step()
    assert bench.follower.recording
    servo.end()


@pytest.mark.parametrize("how", ["die", "end"])
def test_the_last_cycles_of_a_servo_that_is_gone_are_written_and_the_log_is_ended(bench: Bench, how: str) -> None:
    servo, rows = FakeServo(bench.arm), make_rows(100, N)
    bench.step()
    servo.cycles(rows)
    getattr(servo, how)()
    bench.step()
    assert not bench.follower.recording
    log = bench.log(0)
    np.testing.assert_array_equal(log.rows, rows)
    assert not log.torn
    assert "100 cycles, 0 lost" in bench.lines[-1]


def test_a_dead_servos_memory_is_not_recorded_again(bench: Bench) -> None:
    FakeServo(bench.arm).die()
    bench.step()
    assert not bench.follower.recording
    assert bench.opened == []


@pytest.mark.parametrize("how", ["die", "end"])
def test_a_restarted_servo_gets_a_log_of_its_own(bench: Bench, how: str) -> None:
    first, second = make_rows(50, N), make_rows(70, N, first=1000)
    servo = FakeServo(bench.arm)
    servo.cycles(first)
    bench.step()
    bench.step()
    getattr(servo, how)()
    servo = FakeServo(bench.arm)  # between two looks of the follower
    servo.cycles(second)
    for _ in range(3):
        bench.step()
    bench.follower.close()
    np.testing.assert_array_equal(bench.log(0).rows, first)
    np.testing.assert_array_equal(bench.log(1).rows, second)
    servo.end()


def test_a_log_that_begins_beside_an_old_servo_has_lost_nothing(bench: Bench) -> None:
    rows = make_rows(CAPACITY + CAPACITY // 20, N)
    servo = FakeServo(bench.arm)
    servo.cycles(rows[:CAPACITY])
    bench.step()  # finds it; the servo goes on while the log is opened
    servo.cycles(rows[CAPACITY:])
    bench.step()
    servo.end()
    bench.step()
    log = bench.log(0)
    assert log.status.lost == 0
    np.testing.assert_array_equal(log.rows, rows[-log.rows.size :])
    assert log.rows.size > CAPACITY // 2


def test_lost_cycles_are_reported_in_one_line_a_second_at_most(bench: Bench) -> None:
    servo = FakeServo(bench.arm)
    for _ in range(20):
        servo.cycles(make_rows(CAPACITY + 44, N))
        bench.step()
    reports = [line for line in bench.lines if "cycles lost" in line]
    assert 1 < len(reports) <= 1 + 20 * LOOK_NS // 1_000_000_000
    servo.end()


def test_a_refusal_to_open_the_log_reaches_the_caller(bench: Bench, tmp_path: Path) -> None:
    servo = FakeServo(bench.arm)
    bench.paths[0] = tmp_path / "absent" / "x.mcap"
    with pytest.raises(Exception, match="cannot write the log"):
        bench.step()
    servo.end()


def test_file_names_tell_arm_and_time_and_never_hit_an_existing_log(tmp_path: Path) -> None:
    now = datetime(2026, 11, 21, 9, 30, tzinfo=UTC)
    names = []
    for _ in range(3):
        path = fresh_path(tmp_path, "left", now)
        path.touch()
        names.append(path.name)
    stem = "left-20261121T093000Z"
    assert names == [f"{stem}.mcap", f"{stem}-2.mcap", f"{stem}-3.mcap"]


def test_a_named_file_is_used_once_and_later_logs_stand_beside_it(tmp_path: Path) -> None:
    paths = log_paths(tmp_path / "new" / "run.mcap", "left")
    assert next(paths) == tmp_path / "new" / "run.mcap"
    following = next(paths)
    assert following.parent == tmp_path / "new"
    assert following.name.startswith("left-")
    assert next(log_paths(tmp_path / "other", "left")).parent == tmp_path / "other"
