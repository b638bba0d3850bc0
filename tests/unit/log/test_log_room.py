"""`keep_gb`: the oldest files of an arm's logs go, and those that are left are read."""

from __future__ import annotations

import os
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from qrobot.config.deployment import LogChoice
from qrobot.errors import LogError
from qrobot.log.read import read_log
from qrobot.log.room import GIGABYTE, PARTS, LogRoom
from qrobot.log.topics import part_path
from qrobot.log.windows import LogWindows
from qrobot.log.writer import LogWriter
from qrobot.pendant.log_shelf import LogShelf
from qrobot.realtime.shared_memory import own
from tests.support.log_samples import make_header, make_rows

KEPT_GB = 2e-3
OTHERS = ["other-20251101T000000Z.mcap", "left-notes.mcap", "left-20251101T000000Z.txt", "left.mcap", "incidents"]


def sized(folder: Path, name: str, size: int = 0) -> Path:
    path = folder / name
    path.write_bytes(bytes(size))
    return path


def room(said: list[str], keep_gb: float | None = KEPT_GB, part_bytes: int = GIGABYTE) -> LogRoom:
    return LogRoom("left", keep_gb, part_bytes, said.append)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir() if path.name not in OTHERS)


def test_the_oldest_go_by_the_time_in_their_names_until_there_is_room_for_a_whole_file(tmp_path: Path) -> None:
    said: list[str] = []
    files = [
        "left-20261101T000000Z.mcap",
        "left-20261102T000000Z.mcap",
        "left-20261102T000000Z.0002.mcap",
        "left-20261102T000000Z.0010.mcap",
        "left-20261102T000000Z-2.mcap",
        "left-20261102T000000Z-10.mcap",
    ]
    for name in (*reversed(files), *OTHERS[:-1]):
        sized(tmp_path, name, 400_000)
    (tmp_path / OTHERS[-1]).mkdir()
    newest = sized(tmp_path, "left-20261103T000000Z.mcap")
    room(said).make(newest)
    assert names(tmp_path) == sorted([*files[-3:], newest.name])  # 1.2 MB, and a whole file of 0.5
    assert all((tmp_path / name).exists() for name in OTHERS)
    assert len(said) == 1
    assert all(name in said[0] for name in files[:3])
    room(said).make(newest)
    assert len(said) == 1


@pytest.mark.parametrize("size", [0, 1, 100_000, 400_000])
def test_all_files_together_never_have_more(size: int, tmp_path: Path) -> None:
    keeper = room([])
    for number in range(40):
        newest = sized(tmp_path, f"left-202611{number:02d}T000000Z.mcap")
        keeper.make(newest)
        newest.write_bytes(bytes(min(size, keeper.file_bytes)))
        assert sum(path.stat().st_size for path in tmp_path.iterdir()) <= KEPT_GB * GIGABYTE
    assert len(names(tmp_path)) >= min(40, PARTS)


def test_parts_under_a_name_that_a_user_gave_never_have_more_together(tmp_path: Path) -> None:
    """And a log under another name, which somebody else may have given, stays."""
    keeper, others = room([]), sized(tmp_path, "run.2026.mcap", 400_000)
    for number in range(1, 21):
        newest = sized(tmp_path, part_path(tmp_path / "run.mcap", number).name)
        keeper.make(newest)
        newest.write_bytes(bytes(keeper.file_bytes))
        assert sum(path.stat().st_size for path in tmp_path.iterdir() if path != others) <= KEPT_GB * GIGABYTE
    kept = [part_path(tmp_path / "run.mcap", number).name for number in range(20 - PARTS + 1, 21)]
    assert names(tmp_path) == sorted([others.name, *kept])


def test_a_log_under_a_name_that_a_user_gave_is_as_old_as_its_files(tmp_path: Path) -> None:
    keeper = room([], part_bytes=100)
    begun = [
        ("left-20261101T000000Z.mcap", 1),
        ("left-20261101T000000Z.0002.mcap", 1),
        ("run.mcap", 2),
        ("run.0002.mcap", 3),
        ("left-20261104T000000Z.mcap", 4),
        ("left-20261105T000000Z.mcap", 5),
    ]
    for name, day in begun:
        path, time_s = sized(tmp_path, name, 350_000), datetime(2026, 11, day, tzinfo=UTC).timestamp()
        os.utime(path, (time_s, time_s))
        keeper.make(path)
    left = [name for name, _ in begun]
    assert names(tmp_path) == sorted(left)
    for day in range(6, 12):
        left = [*left[1:], f"left-202611{day:02d}T000000Z.mcap"]
        keeper.make(sized(tmp_path, left[-1], 350_000))
        assert names(tmp_path) == sorted(left)


def test_without_keep_gb_nothing_is_removed(tmp_path: Path) -> None:
    said: list[str] = []
    files = [sized(tmp_path, f"left-2026110{k}T000000Z.mcap", 400_000) for k in range(10)]
    keeper = room(said, LogChoice().keep_gb, 1000)
    keeper.make(files[-1])
    assert (len(names(tmp_path)), keeper.file_bytes, said) == (10, 1000, [])


def test_a_disk_that_removes_nothing_is_told_of_and_the_log_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuses(_path: Path, missing_ok: bool = False) -> None:
        raise PermissionError(13, "Permission denied")

    said: list[str] = []
    for k in range(9):
        sized(tmp_path, f"left-2026110{k}T000000Z.mcap", 400_000)
    monkeypatch.setattr(Path, "unlink", refuses)
    writer = LogWriter(tmp_path / "left-20261201T000000Z.mcap", make_header(), begun=room(said).make)
    writer.append(make_rows(10))
    writer.close()
    assert ["Permission denied" in line for line in said] == [True]
    assert read_log(writer.path).rows.size == 10


def test_what_is_left_of_a_long_log_is_read_as_one_log_from_its_oldest_part_on(tmp_path: Path) -> None:
    said: list[str] = []
    keeper = room(said, 1.6e-3)
    rows = make_rows(30_000)
    path = tmp_path / "left-20261101T000000Z.mcap"
    writer = LogWriter(path, make_header(), max_bytes=keeper.file_bytes, begun=keeper.make)
    for start in range(0, rows.size, 500):
        writer.append(rows[start : start + 500])
        writer.flush()
    writer.close()
    left = sorted(tmp_path.iterdir())
    assert said
    assert path not in left
    assert left[-1] == writer.parts[-1]
    log = read_log(left[0])
    assert log.parts == tuple(left)
    np.testing.assert_array_equal(log.rows, rows[-log.rows.size :])
    assert [each["name"] for each in LogShelf([tmp_path]).listing()] == [str(left[0])]
    windows = LogWindows(left[0])
    while windows.read_on():
        pass
    assert windows.end_s == pytest.approx(float(log.time_s[-1]))


def test_a_log_that_a_user_has_given_a_number_is_no_part_of_another_one(tmp_path: Path) -> None:
    first, second = tmp_path / "run.2025.mcap", tmp_path / "run.2026.mcap"
    for file, size in ((first, 10), (second, 20)):
        writer = LogWriter(file, make_header())
        writer.append(make_rows(size))
        writer.close()
    assert (read_log(first).rows.size, read_log(second).rows.size) == (10, 20)
    assert part_path(first, 2).name == "run.2025.0002.mcap"


def test_a_log_that_another_recorder_is_writing_stays_until_that_has_ended(tmp_path: Path) -> None:
    written = tmp_path / "left-20261101T000000Z.mcap"
    other = LogWriter(written, make_header())
    later = [sized(tmp_path, f"left-2026110{day}T000000Z.mcap", 900_000) for day in (2, 3)]
    newest = sized(tmp_path, "left-20261104T000000Z.mcap")
    room([]).make(newest)
    assert names(tmp_path) == [written.name, later[1].name, newest.name]
    other.append(make_rows(10))
    other.close()
    assert read_log(written).rows.size == 10
    sized(tmp_path, "left-20261105T000000Z.mcap", 900_000)
    room([]).make(newest)
    assert written.name not in names(tmp_path)


def test_what_another_recorder_is_writing_takes_no_room_of_what_may_stay(tmp_path: Path) -> None:
    kept = sized(tmp_path, "left-20261102T000000Z.mcap", 900_000)
    newest = sized(tmp_path, "left-20261103T000000Z.mcap")
    with (tmp_path / "left-20261101T000000Z.mcap").open("wb") as written:
        written.write(bytes(5_000_000))
        written.flush()
        assert own(written.fileno())
        room([]).make(newest)
    assert kept.exists()


def test_parts_of_one_recorder_together_never_have_more(tmp_path: Path) -> None:
    keeps = room([], keep_gb=1e-4)
    most: list[int] = []

    def begun(path: Path) -> None:
        keeps.make(path)
        most.append(sum(file.stat().st_size for file in tmp_path.iterdir() if file != path))

    writer = LogWriter(tmp_path / "left-20261101T000000Z.mcap", make_header(), (), keeps.file_bytes, begun=begun)
    for chunk in np.array_split(make_rows(20_000), 100):
        writer.append(chunk)
        writer.flush()
    writer.close()
    assert len(most) > 2 * PARTS
    assert max(most) <= 100_000 - keeps.file_bytes


def test_a_log_that_is_being_written_is_not_begun_by_a_second_recorder(tmp_path: Path) -> None:
    path = tmp_path / "left.mcap"
    writer = LogWriter(path, make_header())
    with pytest.raises(LogError, match="another recorder is writing it"):
        LogWriter(path, make_header())
    writer.append(make_rows(10))
    writer.close()
    assert read_log(path).rows.size == 10
