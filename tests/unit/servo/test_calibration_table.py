"""Calibration tables as files: what is written is read back, and what is damaged is told from what is whole."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.config import Robot, load_robot
from qrobot.errors import ConfigError
from qrobot.servo.calibration.table import (
    MOST_ROWS,
    CalibrationTable,
    calibration_params,
    format_table,
    load_table,
    parse_table,
    rows_crc,
    table_path,
    write_table,
)

ROBOT = load_robot("puma560")
WHOLE = table_path("puma560").read_text()
VENDOR = "joint 1\r\n" + "".join(f"{9000 - 150 * k} {70 + 1000 * k}\r\n" for k in range(12))


def table(joints: int = 2, rows: int = 10) -> CalibrationTable:
    turns = np.arange(rows, dtype=np.int64)
    return CalibrationTable(
        tuple(8000 - 150 * turns + 3 * joint for joint in range(joints)),
        tuple(1000 * turns - 70 + joint for joint in range(joints)),
    )


def rows_of(t: CalibrationTable) -> list[list[int]]:
    return [values.tolist() for pair in zip(t.pots, t.counts, strict=True) for values in pair]


@given(st.integers(1, 8), st.integers(8, 60))
def test_a_table_is_read_back_as_it_was_written(joints: int, rows: int) -> None:
    written = table(joints, rows)
    assert rows_of(parse_table(format_table(written, "made up"), "t")) == rows_of(written)


@pytest.mark.parametrize("text", [VENDOR, VENDOR.replace("joint 1", "1 12")], ids=["joint 1", "1 12"])
def test_both_headers_are_read_without_a_checksum_and_with_line_ends_of_either_kind(text: str) -> None:
    for ends in (text, text.replace("\r\n", "\n")):
        read = parse_table(ends, "t")
        assert read.n == 1
        assert read.pots[0].size == 12
        assert read.pots[0][:2].tolist() == [9000, 8850]
        assert read.counts[0][:2].tolist() == [70, 1070]


@given(st.integers(1, 8), st.integers(8, 60))
def test_the_vendors_format_is_read_back_and_holds_nothing_but_numbers(joints: int, rows: int) -> None:
    """The vendor's driver reads whole numbers in pairs and nothing else: joint and rows, then pot and count."""
    written = table(joints, rows)
    text = format_table(written, "made up", "vendor")
    assert rows_of(parse_table(text, "t")) == rows_of(written)
    assert text.count("\r\n") == text.count("\n") == joints * (rows + 1)
    numbers = [int(word) for word in text.split()]
    for joint in range(1, joints + 1):
        assert numbers[:2] == [joint, rows]
        numbers = numbers[2 * (rows + 1) :]
    assert numbers == []


@given(st.data())
def test_a_table_in_the_vendors_format_that_is_cut_short_is_refused(data: st.DataObject) -> None:
    text = format_table(load_table("puma560", ROBOT), "", "vendor")
    length = data.draw(st.integers(0, len(text) - 4))
    with pytest.raises(ConfigError):
        parse_table(text[:length], "t").check_against(ROBOT, "t")


@pytest.mark.parametrize("name", ["PUMA.TXT", "puma.Txt", "puma.txt"])
def test_the_ending_of_a_table_may_be_in_upper_case(tmp_path: Path, name: str) -> None:
    write_table(tmp_path / name, load_table("puma560", ROBOT), "", "vendor")
    assert rows_of(load_table(tmp_path / name, ROBOT)) == rows_of(load_table("puma560", ROBOT))


def test_the_vendors_first_row_may_be_off_the_line_as_it_is_in_its_sample() -> None:
    parse_table(VENDOR.replace("9000 70", "8900 70"), "t")


def test_the_packaged_table_is_the_pumas() -> None:
    whole = load_table("puma560", ROBOT)
    for joint, (pots, counts) in enumerate(zip(whole.pots, whole.counts, strict=True)):
        low = ROBOT.limits.q_min[joint] - ROBOT.transmission.q_offset[joint]
        high = ROBOT.limits.q_max[joint] - ROBOT.transmission.q_offset[joint]
        ends = np.sort(counts[[0, -1]] * ROBOT.transmission.rad_per_count[joint])
        turn = 2.0 * np.pi / ROBOT.transmission.gear[joint]
        track_ends = pots.min() < abs(ROBOT.transmission.pot_per_rev)  # as on joint 6, within one turn
        assert track_ends or (ends[0] <= low + 3 * turn and ends[1] >= high - 2 * turn)
        assert pots.min() >= 0


@given(st.data())
def test_a_flipped_bit_in_a_row_of_a_table_with_checksum_is_found(data: st.DataObject) -> None:
    start = WHOLE.index("joint 1")
    at = data.draw(st.integers(start, len(WHOLE) - 2))
    flipped = chr(ord(WHOLE[at]) ^ 1 << data.draw(st.integers(0, 6)))
    if flipped.isspace() and WHOLE[at].isspace():
        return  # the same words
    with pytest.raises(ConfigError):
        parse_table(WHOLE[:at] + flipped + WHOLE[at + 1 :], "t")


@given(st.integers(20, len(WHOLE) - 4))
def test_a_table_cut_short_is_refused_wherever_it_is_cut(length: int) -> None:
    with pytest.raises(ConfigError):
        parse_table(WHOLE[:length], "t").check_against(ROBOT, "t")


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda _: "", "no joints in it"),
        (lambda text: text.replace("joint 1", "joint 2"), "t:1: expected `joint 1`, found 'joint 2'"),
        (lambda text: "70 9000\n" + text, "t:1: a row before the first `joint 1`"),
        (lambda text: text.replace("joint 1\r\n", ""), "t:1: expected the header of joint 1, .* found '9000 70'"),
        (lambda text: text.replace("joint 1", "2 12"), "t:1: expected the header of joint 1, .* found '2 12'"),
        (lambda text: text.replace("joint 1", "1 -12"), "t:1: expected the header of joint 1"),
        (lambda text: text.replace("joint 1", "1 13"), "joint 1: 1 rows are missing at the end"),
        (lambda text: text.replace("joint 1", "1 11"), "t:13: expected the header of joint 2"),
        (lambda text: text.replace("9000 70", "nan 70"), "t:2: expected two whole numbers"),
        (lambda text: text.replace("9000 70", "9000"), "t:2: expected two whole numbers"),
        (lambda text: text.replace("9000 70", "9000.5 70"), "t:2: expected two whole numbers"),
        (lambda text: text.replace("9000 70", "9000 99999999"), "t:2: .* is more than converter and counter can show"),
        (lambda text: text.replace("8700 2070", "8850 2070"), "joint 1: the pot reading of row 3 is off the line"),
        (lambda text: text.replace("8700 2070", "8999 2070"), "joint 1: the pot reading of row 3 is off the line"),
        (lambda text: text.replace("8700 2070", "8700 2071"), "joint 1: row 3 is not one motor turn after"),
        (lambda text: re.sub(r"(\d{4}) \d+\r", r"\1 70\r", text), "is not one motor turn after"),
        (lambda text: text[:60], "rows, 8 to 256 are needed"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(change: Callable[[str], str], complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint):
        parse_table(change(VENDOR), "t")


def with_rows(joint: int, line: Callable[[int, int], str]) -> str:
    """The packaged table without checksum, the rows of one joint changed."""
    out, now = [], 0
    for text in WHOLE.splitlines():
        if text.startswith("joint"):
            now = int(text.split()[1])
        elif not text.startswith("#") and now == joint:
            text = line(*(int(word) for word in text.split()))  # noqa: PLW2901
        out.append(text)
    return "\n".join(out[1:])


def test_another_arms_table_is_refused() -> None:
    with pytest.raises(ConfigError, match="1 joints, puma560 has 6"):
        parse_table(VENDOR, "t").check_against(ROBOT, "t")
    with pytest.raises(ConfigError, match="joint 3: index at 333 of a turn, puma560 has it at 332"):
        parse_table(with_rows(3, lambda pot, count: f"{pot} {count + 1}"), "t").check_against(ROBOT, "t")


def test_a_scale_that_is_one_percent_off_is_refused() -> None:
    first = int(load_table("puma560", ROBOT).counts[0][0])
    wrong = with_rows(1, lambda pot, count: f"{pot} {first + (count - first) * 101 // 100}")
    with pytest.raises(ConfigError, match="joint 1: rows are 1010 counts apart, puma560 has \\+1000 a turn"):
        parse_table(wrong, "t").check_against(ROBOT, "t")


def test_a_table_of_the_other_direction_is_refused() -> None:
    lines = WHOLE.splitlines()
    start, end = lines.index("joint 1") + 1, lines.index("joint 2")
    backwards = "\n".join([*lines[1:start], *reversed(lines[start:end]), *lines[end:]])
    with pytest.raises(ConfigError, match="rows are -1000 counts apart"):
        parse_table(backwards, "t").check_against(ROBOT, "t")


def with_transmission(**values: object) -> Robot:
    """The PUMA with another transmission."""
    return ROBOT.model_copy(update={"transmission": ROBOT.transmission.model_copy(update=values)})


def test_a_table_of_potentiometers_that_rise_the_other_way_is_refused() -> None:
    """As of an arm whose count_sign was turned round for joint 1: its counts rise with its potentiometer."""
    signs = ROBOT.transmission.count_sign * [-1, 1, 1, 1, 1, 1]
    phases = np.array([-70, *ROBOT.transmission.index_phase[1:]])
    turned = parse_table(with_rows(1, lambda pot, count: f"{pot} {-count}"), "t")
    told = r"t: joint 1: its readings .* \+150\.1 a motor turn, puma560 has .* pot_per_rev -150\.1: .* count_sign"
    with pytest.raises(ConfigError, match=told):
        turned.check_against(with_transmission(count_sign=signs, index_phase=phases), "t")
    each = np.array([150.1, *[-150.1] * 5])
    turned.check_against(with_transmission(count_sign=signs, index_phase=phases, pot_per_rev=each), "t")


@pytest.mark.parametrize("turns", [3, -3, 1.5])
def test_a_table_of_a_potentiometer_that_is_mounted_elsewhere_is_refused(turns: float) -> None:
    zero = ROBOT.transmission.pot_at_zero + 150.1 * turns * np.eye(6)[1]
    with pytest.raises(ConfigError, match=rf"joint 2: its readings are 85\d\d at .* pot_at_zero {zero[1]:.0f} and"):
        load_table("puma560", with_transmission(pot_at_zero=zero))


def test_a_slope_that_leads_to_another_turn_at_the_ends_of_the_table_is_refused() -> None:
    load_table("puma560", with_transmission(pot_per_rev=-151.0))
    with pytest.raises(ConfigError, match=r"joint 1: .* pot_per_rev -160\.0"):
        load_table("puma560", with_transmission(pot_per_rev=-160.0))


def test_a_missing_table_names_those_there_are() -> None:
    with pytest.raises(ConfigError, match="puma56"):
        load_table("puma56", ROBOT)
    with pytest.raises(ConfigError, match=r"no configuration file nowhere\.txt"):
        load_table("nowhere.txt", ROBOT)


def test_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.txt"
    path.write_bytes(b"\xff\x00joint 1\n")
    with pytest.raises(ConfigError, match="qrobot calibrate --make-table"):
        load_table(path, ROBOT)


def test_a_writer_that_dies_leaves_the_old_table_and_no_debris(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "t.txt"
    write_table(path, table(1, 10), "the old one")
    old = path.read_text()

    def die(_handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", die)
    with pytest.raises(ConfigError, match="No space left on device"):
        write_table(path, table(1, 20), "the new one")
    assert path.read_text() == old
    assert os.listdir(tmp_path) == ["t.txt"]


def test_a_written_table_replaces_the_old_one_and_carries_its_checksum(tmp_path: Path) -> None:
    path = tmp_path / "new" / "t.txt"
    write_table(path, table(1, 10), "one")
    write_table(path, table(1, 12), "two")
    lines = path.read_text().splitlines()
    assert lines[0] == f"# crc32 {rows_crc(lines)}"
    assert parse_table(path.read_text(), "t").pots[0].size == 12


def test_the_cycle_gets_arrays_of_one_size_whatever_the_table() -> None:
    none, some = calibration_params(2, None), calibration_params(2, table(2, 10))
    assert none.rows.tolist() == [0, 0]
    assert some.rows.tolist() == [10, 10]
    assert none.pot.shape == some.pot.shape == (2, MOST_ROWS)
