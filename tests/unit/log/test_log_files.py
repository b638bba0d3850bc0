"""Log files: what was written comes back, whatever became of the writer and the disk."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.opcode import Opcode

from qrobot.errors import LogError
from qrobot.faultcodes import NO_JOINT
from qrobot.log.damage import record_at
from qrobot.log.header import LOCKSTEP, Attachment, LogHeader
from qrobot.log.read import read_log
from qrobot.log.record import BACKLOG_BYTES, FLUSH_NS, LogRecorder, write_log
from qrobot.log.status import LogStatus
from qrobot.log.summary import wall_clock
from qrobot.log.topics import later_parts
from qrobot.log.windows import LogWindows
from qrobot.log.writer import LogWriter, remove_log
from qrobot.realtime.setup import SetupStep
from qrobot.servo.memory.law_history import LawInForce
from qrobot.servo.memory.telemetry import TelemetryLayout
from tests.support.log_samples import START_NS, FullDisk, Ring, make_header, make_rows
from tests.support.patience import PATIENCE_S


@pytest.mark.parametrize("n", [1, 6, 9])
@pytest.mark.parametrize("n_rows", [0, 1, 5000])
def test_rows_come_back_bit_for_bit(tmp_path: Path, n: int, n_rows: int) -> None:
    rows = make_rows(n_rows, n)
    write_log(tmp_path / "run.mcap", rows, make_header(n))
    log = read_log(tmp_path / "run.mcap")
    assert log.rows.dtype == rows.dtype
    np.testing.assert_array_equal(log.rows, rows)
    assert not log.torn
    assert log.status.rows == n_rows


def test_the_header_and_the_attached_files_come_back(tmp_path: Path) -> None:
    header = LogHeader(
        robot="scara", joint_names=("base", "lift"), period_ns=500_000, prismatic=(False, True), law="pd",
        clock=LOCKSTEP, plant="mismatched", wall_offset_ns=123, version="9.9",
        setup=(SetupStep("scheduler", False, "refused", "run as root"),),
    )  # fmt: skip
    write_log(tmp_path / "run.mcap", make_rows(3, 2), header, [Attachment("robot.toml", b"a = 1\n")])
    log = read_log(tmp_path / "run.mcap")
    assert log.header == header
    assert log.attachments == {"robot.toml": b"a = 1\n"}
    assert log.header.rate_hz == 2000.0


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("robot", "5"), ("joint_names", '"ab"'), ("joint_names", "[1]"), ("period_ns", "NaN"), ("period_ns", '"x"'),
        ("part", '"x"'), ("wall_offset_ns", '"x"'), ("prismatic", "[3, 4]"), ("setup", "[1]"), ("law", "null"),
        ("version", "[" * 100_000),
    ],
)  # fmt: skip
def test_a_header_with_values_of_another_type_is_damaged(key: str, value: str) -> None:
    told = make_header(2).to_metadata()
    assert LogHeader.from_metadata(told) == make_header(2)
    with pytest.raises(LogError, match="the log's header is damaged"):
        LogHeader.from_metadata(told | {key: value})


def test_a_log_that_began_beyond_the_calendar_has_no_date(tmp_path: Path) -> None:
    write_log(tmp_path / "run.mcap", make_rows(3), make_header())
    log = read_log(tmp_path / "run.mcap")
    for offset in (10**30, -(10**30)):
        assert wall_clock(replace(log, header=replace(log.header, wall_offset_ns=offset))) == ""


def test_time_runs_from_the_first_row_and_the_error_is_desired_minus_measured(tmp_path: Path) -> None:
    rows = make_rows(9)
    write_log(tmp_path / "run.mcap", rows, make_header())
    log = read_log(tmp_path / "run.mcap")
    np.testing.assert_allclose(log.time_s, np.arange(9) * 250e-6, atol=1e-12)
    np.testing.assert_array_equal(log.tracking_error, rows["q_ref"] - rows["q"])


def test_other_tools_find_one_ros_message_per_cycle_at_its_planned_time(tmp_path: Path) -> None:
    from mcap.reader import make_reader

    rows = make_rows(5)
    write_log(tmp_path / "run.mcap", rows, make_header())
    with (tmp_path / "run.mcap").open("rb") as file:
        messages = list(make_reader(file).iter_messages(topics=["/servo/tick"]))
    assert [message.log_time for _, _, message in messages] == rows["t_ns"].tolist()
    schema, channel, message = messages[2]
    assert (channel.message_encoding, schema.encoding, schema.name) == ("cdr", "ros2msg", "qrobot_msgs/msg/ServoTick6")
    assert message.data == b"\x00\x01\x00\x00" + rows[2].tobytes()
    assert [line.split("  #")[0] for line in schema.data.decode().splitlines()][7:9] == [
        "int64 flags",
        "float64[6] q_ref",
    ]


def test_a_log_rotates_by_size_and_is_read_as_one(tmp_path: Path) -> None:
    rows = make_rows(30_000)
    files = write_log(tmp_path / "run.mcap", rows, make_header(), [Attachment("a", b"b")], max_bytes=500_000)
    assert [file.name for file in files][:3] == ["run.mcap", "run.0002.mcap", "run.0003.mcap"]
    assert all(file.stat().st_size < 1_000_000 for file in files)
    log = read_log(files[0])
    np.testing.assert_array_equal(log.rows, rows)
    assert log.parts == tuple(files)
    second = read_log(files[1])
    assert second.header.part == 2
    assert second.attachments == {"a": b"b"}


def test_an_overwritten_log_does_not_inherit_parts_of_the_old_one(tmp_path: Path) -> None:
    write_log(tmp_path / "run.mcap", make_rows(30_000), make_header(), max_bytes=500_000)
    write_log(tmp_path / "run.mcap", make_rows(10), make_header())
    assert read_log(tmp_path / "run.mcap").rows.size == 10


@pytest.mark.parametrize("end", ["removed", "overwritten"])
def test_no_part_of_an_old_log_stays_although_earlier_ones_have_gone(tmp_path: Path, end: str) -> None:
    files = write_log(tmp_path / "run.mcap", make_rows(30_000), make_header(), max_bytes=300_000)
    others = [tmp_path / name for name in ("run.mcap.txt", "run.12.mcap", "run.0003x.mcap", "rune.0003.mcap")]
    for other in others:
        other.write_bytes(b"something else")
    own = write_log(tmp_path / "run.2025.mcap", make_rows(10), make_header())[0]  # a log of that year
    assert later_parts(files[0]) == [*files[1:], own]
    for gone in files[:3]:
        gone.unlink()
    if end == "removed":
        remove_log(files[0])
    else:
        write_log(files[0], make_rows(10), make_header())
        assert read_log(files[0]).rows.size == 10
    assert not any(part.exists() for part in files[1:])
    assert all(other.exists() for other in (*others, own))


def test_each_part_of_a_log_tells_the_law_in_force(tmp_path: Path) -> None:
    law = LawInForce(0, 0, "pd", "frequency=8", (1.0,) * 6, (2.0,) * 6, (3.0,) * 6)
    other = replace(law, tick=12_000, t_ns=START_NS, law="qrobot")
    writer = LogWriter(tmp_path / "run.mcap", make_header(), max_bytes=300_000)
    for first in range(0, 30_000, 1000):
        writer.append(make_rows(1000, first=first))
        if first in (0, 12_000):
            writer.append_law(other if first else law)
        writer.flush()
    writer.close()
    parts = writer.parts
    assert read_log(parts[0]).laws == (law, other)
    assert [read_log(part).laws[0].law for part in (parts[0], parts[1], parts[-1])] == ["pd", "pd", "qrobot"]
    windows = LogWindows(parts[0])
    while windows.read_on():
        pass
    assert windows.log.laws == (law, other)
    for part in parts[:-1]:
        part.unlink()
    assert read_log(parts[-1]).laws == (other,)


@pytest.mark.parametrize("written", [b"", b"\x89MCAP0\r\n"])
def test_a_part_that_was_cut_off_before_its_header_ends_a_log(tmp_path: Path, written: bytes) -> None:
    """A full disk, or a kill, right behind a rotation."""
    write_log(tmp_path / "run.mcap", make_rows(100), make_header())
    (tmp_path / "run.0002.mcap").write_bytes(written)
    log = read_log(tmp_path / "run.mcap")
    assert log.rows.size == 100
    assert log.torn
    windows = LogWindows(tmp_path / "run.mcap")
    while windows.read_on():
        pass
    assert not windows.whole


def test_parts_of_different_logs_are_not_joined(tmp_path: Path) -> None:
    write_log(tmp_path / "run.mcap", make_rows(10), make_header())
    write_log(tmp_path / "other.mcap", make_rows(10, 2), make_header(2))
    (tmp_path / "other.mcap").rename(tmp_path / "run.0002.mcap")
    with pytest.raises(LogError, match="does not belong"):
        read_log(tmp_path / "run.mcap")


def test_a_recorder_that_keeps_up_writes_every_row(tmp_path: Path) -> None:
    ring, rows = Ring(), make_rows(4000)
    recorder = LogRecorder(ring.reader(), LogWriter(tmp_path / "run.mcap", make_header()))
    for i in range(0, 4000, 40):
        ring.append(rows[i : i + 40])
        assert recorder.poll(now_ns=i * 250_000) == 40
    recorder.close()
    log = read_log(tmp_path / "run.mcap")
    np.testing.assert_array_equal(log.rows, rows)
    assert log.status == LogStatus(int(rows["t_ns"][-1]), 4000, 0, 0, 0)


def test_rows_that_the_ring_overwrote_are_counted_in_the_log(tmp_path: Path) -> None:
    ring, rows = Ring(64), make_rows(300)
    recorder = LogRecorder(ring.reader(), LogWriter(tmp_path / "run.mcap", make_header()))
    ring.append(rows[:50])
    recorder.poll(0)
    ring.append(rows[50:])  # 250 rows into a ring that keeps 63
    recorder.close()
    log = read_log(tmp_path / "run.mcap")
    assert log.rows["tick"].tolist() == [*range(50), *range(237, 300)]
    assert (log.status.rows, log.status.lost) == (113, 187)


def test_a_recorder_started_late_saves_what_the_ring_still_has(tmp_path: Path) -> None:
    ring = Ring(64)
    ring.append(make_rows(100))
    recorder = LogRecorder(ring.reader(), LogWriter(tmp_path / "run.mcap", make_header()))
    recorder.close()
    log = read_log(tmp_path / "run.mcap")
    assert log.rows["tick"].tolist() == list(range(37, 100))
    assert log.status.lost == 0


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("log") / "run.mcap"
    writer = LogWriter(path, make_header(2))
    for i in range(20):
        writer.append(make_rows(50, 2, first=50 * i))
        writer.flush()
    writer.close()
    return path.read_bytes()


def cut_points(data: bytes) -> list[int]:
    return sorted({*range(0, 400, 7), *np.linspace(0, len(data) - 1, 150).astype(int).tolist()})


def test_a_log_cut_anywhere_yields_whole_flushes_from_its_beginning_or_a_log_error(
    tmp_path: Path, whole: bytes
) -> None:
    path, expected, sizes = tmp_path / "cut.mcap", make_rows(1000, 2), []
    for length in cut_points(whole):
        path.write_bytes(whole[:length])
        try:
            log = read_log(path)
        except LogError:
            assert length < 400
            continue
        assert log.rows.size % 50 == 0
        np.testing.assert_array_equal(log.rows, expected[: log.rows.size])
        sizes.append(log.rows.size)
    assert sizes == sorted(sizes)
    assert sizes[0] == 0
    assert sizes[-1] == 1000


def test_a_cut_log_is_marked_as_torn(tmp_path: Path, whole: bytes) -> None:
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    assert read_log(tmp_path / "cut.mcap").torn
    (tmp_path / "whole.mcap").write_bytes(whole)
    assert not read_log(tmp_path / "whole.mcap").torn


def test_garbled_bytes_never_give_wrong_rows(tmp_path: Path, whole: bytes) -> None:
    path, expected, rng = tmp_path / "garbled.mcap", make_rows(1000, 2), np.random.default_rng(1)
    for _ in range(300):
        data = bytearray(whole)
        for at in rng.integers(600, len(whole), 3):  # behind the header, which has no checksum
            data[at] ^= int(rng.integers(1, 256))
        path.write_bytes(data)
        try:
            log = read_log(path)
        except LogError:
            continue
        np.testing.assert_array_equal(log.rows, expected[log.rows["tick"]])


def chunks_of(data: bytes) -> list[tuple[int, int]]:
    """Begin and end of each chunk's record."""
    view, at, found = memoryview(data), len(b"\x89MCAP0\r\n"), []
    while (record := record_at(view, at)).opcode != Opcode.DATA_END:
        if record.opcode == Opcode.CHUNK:
            found.append((at, record.end))
        at = record.end
    return found


def test_whatever_is_damaged_every_whole_chunk_comes_back_and_the_rest_is_told(tmp_path: Path, whole: bytes) -> None:
    path, expected, rng = tmp_path / "damaged.mcap", make_rows(1000, 2), np.random.default_rng(2)
    chunks = chunks_of(whole)
    assert len(chunks) == 21  # the last one has a status alone
    for begin in rng.integers(chunks[0][0], chunks[-1][1] - 8, 200):
        data = bytearray(whole)
        data[begin : begin + 8] = bytes(byte ^ 0xFF for byte in data[begin : begin + 8])
        path.write_bytes(data)
        log = read_log(path)
        hit = [k for k, (first, end) in enumerate(chunks) if first < begin + 8 and begin < end]
        there = [tick for tick in range(1000) if tick // 50 not in hit]
        assert set(there) <= set(log.rows["tick"].tolist())
        np.testing.assert_array_equal(log.rows, expected[log.rows["tick"]])
        missing = 1000 - log.rows.size
        told = [lost.cycles for lost in log.lost]
        assert sum(cycles for cycles in told if cycles is not None) == missing or None in told
        assert told or not missing


def test_lost_cycles_are_told_with_their_time(tmp_path: Path, whole: bytes) -> None:
    begin, end = chunks_of(whole)[7]
    data = bytearray(whole)
    data[(begin + end) // 2] ^= 0xFF
    (tmp_path / "damaged.mcap").write_bytes(data)
    (lost,) = read_log(tmp_path / "damaged.mcap").lost
    assert (lost.cycles, lost.begin_s, lost.end_s) == (50, pytest.approx(350 * 250e-6), pytest.approx(399 * 250e-6))
    assert lost.line == "50 cycles from 0.0875 s to 0.0998 s"


@pytest.mark.parametrize("number", [0, 19])
def test_the_first_and_the_last_chunk_may_be_lost_too(tmp_path: Path, number: int) -> None:
    writer = LogWriter(tmp_path / "run.mcap", replace(make_header(2), wall_offset_ns=1_700_000_000 * 10**9))
    for i in range(20):
        writer.append(make_rows(50, 2, first=50 * i))
        writer.flush()
    writer.close()
    data = bytearray((tmp_path / "run.mcap").read_bytes())
    begin, end = chunks_of(bytes(data))[number]
    data[(begin + end) // 2] ^= 0xFF
    (tmp_path / "damaged.mcap").write_bytes(data)
    log = read_log(tmp_path / "damaged.mcap")
    assert log.rows.size == 950
    assert [lost.cycles for lost in log.lost] == [50]
    assert not log.torn


def test_a_hole_between_the_parts_of_a_log_is_told(tmp_path: Path) -> None:
    rows = make_rows(30_000)
    files = write_log(tmp_path / "run.mcap", rows, make_header(), max_bytes=500_000)
    data = bytearray(files[1].read_bytes())
    begin, end = chunks_of(bytes(data))[0]
    data[(begin + end) // 2] ^= 0xFF
    files[1].write_bytes(data)
    log = read_log(files[0])
    (lost,) = log.lost
    assert lost.cycles == 30_000 - log.rows.size > 0


@pytest.mark.parametrize("content", [b"", b"hello", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n" + bytes(100)])
def test_a_file_that_is_no_log_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "x.mcap").write_bytes(content)
    with pytest.raises(LogError, match=r"x\.mcap"):
        read_log(tmp_path / "x.mcap")


def test_a_missing_log_and_an_unwritable_place_are_log_errors(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="No such file"):
        read_log(tmp_path / "absent.mcap")
    with pytest.raises(LogError, match="cannot write"):
        write_log(tmp_path / "absent" / "run.mcap", make_rows(1), make_header())


def test_an_old_part_that_cannot_be_removed_is_a_log_error(tmp_path: Path) -> None:
    (tmp_path / "run.0002.mcap").mkdir()
    with pytest.raises(LogError, match=r"cannot remove .*run\.0002\.mcap"):
        write_log(tmp_path / "run.mcap", make_rows(1), make_header())


def test_a_log_that_cannot_be_begun_costs_no_part_of_an_earlier_one(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").mkdir()
    (tmp_path / "run.0002.mcap").write_bytes(b"a part")
    with pytest.raises(LogError, match=r"cannot write the log .*run\.mcap"):
        write_log(tmp_path / "run.mcap", make_rows(1), make_header())
    assert (tmp_path / "run.0002.mcap").read_bytes() == b"a part"


def test_a_log_of_another_format_is_refused_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("qrobot.log.header.FORMAT", "99")
    write_log(tmp_path / "run.mcap", make_rows(1), make_header())
    monkeypatch.undo()
    with pytest.raises(LogError, match="'99'"):
        read_log(tmp_path / "run.mcap")


def test_a_full_disk_delays_rows_but_spoils_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ring, rows = Ring(8192), make_rows(6000)
    recorder = LogRecorder(ring.reader(), LogWriter(tmp_path / "run.mcap", make_header()))
    disk = FullDisk(monkeypatch, room=100_000)
    for i in range(30):
        disk.room += 10**9 if i == 20 else 0  # room again after a while
        ring.append(rows[i * 200 : (i + 1) * 200])
        recorder.poll(now_ns=i * FLUSH_NS)
    recorder.close()
    assert recorder.status.disk_errors > 0
    assert recorder.last_error == os.strerror(errno.ENOSPC)
    log = read_log(tmp_path / "run.mcap")
    np.testing.assert_array_equal(log.rows, rows)
    assert log.status.disk_errors == recorder.status.disk_errors
    assert not log.torn


def test_what_is_on_a_full_disk_is_readable_up_to_where_it_filled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = make_rows(6000)
    FullDisk(monkeypatch, room=400_000)
    with pytest.raises(LogError, match="incomplete"):
        write_log(tmp_path / "run.mcap", rows, make_header())
    log = read_log(tmp_path / "run.mcap")
    assert log.torn
    assert 0 < log.rows.size < 6000
    np.testing.assert_array_equal(log.rows, rows[: log.rows.size])


def test_memory_stays_bounded_while_the_disk_is_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("qrobot.log.record.BACKLOG_BYTES", 200_000)
    ring = Ring(1024)
    writer = LogWriter(tmp_path / "run.mcap", make_header())
    recorder = LogRecorder(ring.reader(), writer)
    disk = FullDisk(monkeypatch, room=0)
    for i in range(60):
        ring.append(make_rows(500, first=500 * i))
        recorder.poll(now_ns=i * FLUSH_NS)
    assert writer.backlog < 400_000 < BACKLOG_BYTES
    disk.room = 10**9
    while recorder.poll(now_ns=100 * FLUSH_NS):
        pass
    recorder.close()
    log = read_log(tmp_path / "run.mcap")
    assert log.status.lost > 0
    assert log.rows.size + log.status.lost == 30_000
    np.testing.assert_array_equal(log.rows["tick"][-1023:], np.arange(30_000 - 1023, 30_000))


def test_a_part_that_cannot_be_opened_lets_the_log_grow_in_the_old_one(
    tmp_path: Path,
) -> None:
    writer = LogWriter(tmp_path / "run.mcap", make_header(), max_bytes=100_000)
    (tmp_path / "run.0002.mcap").mkdir()
    for i in range(3):
        writer.append(make_rows(1000, first=1000 * i))
        writer.flush()
    assert writer.status.disk_errors >= 2
    assert "run.0002.mcap" in writer.last_error
    (tmp_path / "run.0002.mcap").rmdir()
    writer.append(make_rows(1000, first=3000))
    writer.flush()
    writer.close()
    np.testing.assert_array_equal(read_log(tmp_path / "run.mcap").rows, make_rows(4000))
    assert len(writer.parts) == 2


KILLED = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from tests.support.log_samples import make_header, make_rows
from qrobot.log.writer import LogWriter
writer = LogWriter(Path(sys.argv[1]), make_header())
for i in range(10):
    writer.append(make_rows(100, first=100 * i))
    if i != 9:
        writer.flush()
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_kill_9_of_the_writer_costs_no_more_than_the_last_flush(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    command = [sys.executable, "-c", KILLED, str(path), str(Path(__file__).parent)]
    assert subprocess.run(command, check=False, timeout=PATIENCE_S).returncode == -9
    log = read_log(path)
    assert log.torn
    assert log.status.rows == 900
    assert log.rows["t_ns"][0] == START_NS
    np.testing.assert_array_equal(log.rows, make_rows(900))


def test_a_log_of_version_1_reads_as_ever_and_its_missing_numbers_are_nan(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, old = make_rows(50), TelemetryLayout(6, 1)
    rows = old.empty(50)
    for name in old.dtype.names or ():
        rows[name] = whole[name]
    with monkeypatch.context() as before:
        before.setattr(LogHeader, "layout", property(lambda header: TelemetryLayout(header.n, 1)))
        write_log(tmp_path / "old.mcap", rows, make_header())
    read = read_log(tmp_path / "old.mcap").rows
    assert read.dtype == TelemetryLayout(6).dtype
    for name in read.dtype.names or ():
        if name in (old.dtype.names or ()):
            np.testing.assert_array_equal(read[name], rows[name])
        elif read.dtype[name].base.kind == "f":
            assert np.isnan(read[name]).all()
        else:
            assert (read[name] == (NO_JOINT if name == "event_joint" else 0)).all()
