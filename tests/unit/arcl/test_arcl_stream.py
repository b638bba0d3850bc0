"""The diagnostic stream, from the table of its page alone: see docs/reference/arcl-stream.md."""

from __future__ import annotations

import struct
import sys
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest

from qrobot.arcl.stream import RecordKind, StreamStart, StreamWriter, cartesian_table, joint_table, read_stream
from qrobot.arcl.stream.layout import packed
from qrobot.arcl.stream.tables import ORIENTATIONS, table_text, write_table
from qrobot.arcl.stream.text import stream_lines
from qrobot.arcl.stream.torques import torque_table
from qrobot.config import load_robot
from qrobot.errors import ConfigError, LogError
from qrobot.model.transform import rpy, transform

START = StreamStart("stanford", "RRPRRR", "prog.py", "offl", 56000)
POSE = transform(rpy(0.1, 0.2, 0.3), [0.4, -0.5, 0.6])


def write_some(path: Path, samples: int = 5) -> None:
    writer = StreamWriter(path, START)
    writer.text(RecordKind.REQUEST, "request pos: t=0", 0.0)
    for k in range(samples):
        writer.numbers(RecordKind.JOINTS, np.arange(6.0) + k, 56.0 * k)
        writer.pose(POSE, 56.0 * k)
    writer.numbers(RecordKind.GRIPPER, np.array([3.0, 40.0]), 100.0)
    writer.numbers(RecordKind.OUTPUT, np.array([3.0, 4.0, 9.0]), 100.0)
    writer.event(4, "pos", 200.0)
    writer.close(224.0)
    writer.close(224.0)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    write_some(tmp_path / "run.arcl")
    return tmp_path / "run.arcl"


def headers(data: bytes) -> list[tuple[int, tuple]]:
    """Offset and fields of every header, read as the page tells."""
    found, offset = [], 0
    while offset < len(data):
        fields = struct.unpack_from("<4sHHIIQQd", data, offset)
        found.append((offset, fields))
        offset = fields[6]
    return found


def test_headers_are_linked_both_ways(path: Path) -> None:
    chain = headers(path.read_bytes())
    offsets = [offset for offset, _ in chain]
    assert [fields[5] for _, fields in chain] == [0, *offsets[:-1]]
    assert [fields[6] for _, fields in chain] == [*offsets[1:], path.stat().st_size]
    assert all(fields[0] == b"ARCL" and fields[3] % 8 == 0 for _, fields in chain)


def test_each_record_has_its_checksum(path: Path) -> None:
    data = path.read_bytes()
    for offset, fields in headers(data):
        bare = data[offset : offset + 12] + bytes(4) + data[offset + 16 : offset + 40]
        assert fields[4] == crc32(data[offset + 40 : fields[6]], crc32(bare))


def test_the_first_record_has_magic_number_robot_structure_and_program(path: Path) -> None:
    record = path.read_bytes()[40:]
    assert struct.unpack_from("<8sIIQ", record) == (b"ARCLSTRM", 1, 6, 56000)
    assert record[24:].startswith(b"\x08stanford\x06RRPRRR\x07prog.py\x04offl")
    assert read_stream(path).start == START


def test_a_file_cut_anywhere_gives_every_whole_record(path: Path, tmp_path: Path) -> None:
    data, ends = path.read_bytes(), [fields[6] for _, fields in headers(path.read_bytes())]
    cut = tmp_path / "cut.arcl"
    for end in range(ends[0], len(data), 7):
        cut.write_bytes(data[:end])
        stream = read_stream(cut)
        assert len(stream.records) + 1 == sum(whole <= end for whole in ends)
        assert stream.damage


@pytest.mark.parametrize("seed", range(20))
def test_a_flipped_byte_never_gives_a_wrong_record(path: Path, tmp_path: Path, seed: int) -> None:
    data, good = bytearray(path.read_bytes()), read_stream(path).records
    random = np.random.default_rng(seed)
    data[int(random.integers(len(data)))] ^= 1 << int(random.integers(8))
    spoilt = tmp_path / "spoilt.arcl"
    spoilt.write_bytes(data)
    try:
        found = read_stream(spoilt)
    except LogError:
        return
    assert found.records == good[: len(found.records)]
    assert found.damage


@pytest.mark.parametrize("content", [b"", b"ARCL", b"\0" * 100, b"not a stream at all, but long enough for a header"])
def test_what_is_no_stream_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "x").write_bytes(content)
    with pytest.raises(LogError, match="not an ARCL stream"):
        read_stream(tmp_path / "x")


def test_a_run_that_was_killed_is_told_apart(tmp_path: Path) -> None:
    StreamWriter(tmp_path / "x", START).text(RecordKind.REQUEST, "request", 0.0)
    stream = read_stream(tmp_path / "x")
    assert len(stream.records) == 1
    assert stream.damage.startswith("cut short at byte")


def test_joint_and_cartesian_tables_have_the_units_of_their_names(path: Path) -> None:
    stream = read_stream(path)
    joints, poses = joint_table(stream), cartesian_table(stream)
    assert list(joints) == ["t_s", "j1_deg", "j2_deg", "j3_mm", "j4_deg", "j5_deg", "j6_deg"]
    assert np.allclose(joints["j3_mm"], 1000.0 * (2.0 + np.arange(5)))
    assert np.allclose(joints["j2_deg"], np.degrees(1.0 + np.arange(5)))
    assert np.allclose(joints["t_s"], 0.056 * np.arange(5))
    assert [poses[name][0] for name in ("x_mm", "y_mm", "z_mm")] == pytest.approx([400.0, -500.0, 600.0])
    assert [poses[name][0] for name in ("roll_deg", "pitch_deg", "yaw_deg")] == pytest.approx(
        np.degrees([0.1, 0.2, 0.3])
    )


@pytest.mark.parametrize("orientation", ORIENTATIONS)
def test_orientations_are_told_in_a_variety_of_forms(path: Path, orientation: str) -> None:
    table = cartesian_table(read_stream(path), orientation)
    assert {len(column) for column in table.values()} == {5}
    assert len(table) == 4 + len(ORIENTATIONS[orientation][0])
    assert table_text(table).count("\n") == 6


def test_a_table_of_what_was_measured_needs_a_machine_that_measures(path: Path) -> None:
    with pytest.raises(ConfigError, match="no joint positions were measured: the machine was offl"):
        joint_table(read_stream(path), measured=True)


def test_matrices_and_quaternions_of_a_table_are_the_orientation(path: Path) -> None:
    matrix = cartesian_table(read_stream(path), "matrix")
    assert np.allclose([matrix[f"a{axis}"][0] for axis in "xyz"], POSE[:3, 2])
    quat = cartesian_table(read_stream(path), "quat")
    assert sum(quat[name][0] ** 2 for name in ("qs", "qx", "qy", "qz")) == pytest.approx(1.0)
    with pytest.raises(ConfigError, match="no form"):
        cartesian_table(read_stream(path), "degrees")


def test_a_table_comes_back_from_each_form_of_file(path: Path, tmp_path: Path) -> None:
    table = joint_table(read_stream(path))
    for suffix in ("csv", "npy", "npz", "mat", "parquet"):
        write_table(table, tmp_path / f"t.{suffix}")
    rows = np.column_stack(list(table.values()))
    assert np.array_equal(np.loadtxt(tmp_path / "t.csv", delimiter=",", skiprows=1), rows)
    assert np.array_equal(np.load(tmp_path / "t.npy"), rows)
    with np.load(tmp_path / "t.npz") as arrays:
        assert np.array_equal(arrays["j3_mm"], table["j3_mm"])
    parquet = pytest.importorskip("pyarrow.parquet").read_table(tmp_path / "t.parquet")
    assert np.array_equal(parquet["t_s"].to_numpy(), table["t_s"])
    with pytest.raises(ConfigError, match=r"\.csv, \.parquet"):
        write_table(table, tmp_path / "t.xls")


def test_without_pyarrow_the_way_out_is_named_and_a_file_that_was_there_stays(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = tmp_path / "t.parquet"
    there.write_bytes(b"the one before")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(ConfigError, match=r"qrobot\[logs\]"):
        write_table(joint_table(read_stream(path)), there)
    assert there.read_bytes() == b"the one before"


def test_a_matlab_file_has_a_column_for_each_name(path: Path, tmp_path: Path) -> None:
    """Level 4: five int32, the name with its zero byte, the numbers."""
    table = joint_table(read_stream(path))
    write_table(table, tmp_path / "t.mat")
    data, found = (tmp_path / "t.mat").read_bytes(), {}
    while data:
        kind, rows, columns, imaginary, length = struct.unpack_from("<5i", data)
        name = data[20 : 20 + length - 1].decode()
        end = 20 + length + 8 * rows * columns
        found[name], data = np.frombuffer(data[20 + length : end]), data[end:]
        assert (kind, columns, imaginary) == (0, 1, 0)
    assert {name: list(column) for name, column in found.items()} == {n: list(c) for n, c in table.items()}


def test_unstream_interprets_the_common_records(path: Path) -> None:
    text = "\n".join(stream_lines(read_stream(path)))
    assert "robot stanford, structure RRPRRR, program prog.py, machine offl, dT=56" in text
    for said in ("request pos: t=0", "GRIP_CLOSE_BY 40", "lines 3 to 6 are 9", "EVENT_DONE pos", "x:400.000", "end"):
        assert said in text


def test_a_stream_that_cannot_be_written_is_refused_at_once(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot write the stream"):
        StreamWriter(tmp_path / "no" / "such" / "folder", START)


def test_torques_of_an_arm_that_stands_are_those_published_for_gravity(tmp_path: Path) -> None:
    """PUMA 560 stretched, VAL (0, 0, 90, 0, 0, 0): -45.717, -8.483 and -0.028 N m on joints 2, 3 and 5."""
    writer = StreamWriter(tmp_path / "x", StreamStart("puma560", "RRRRRR", "prog", "offl", 56000))
    stretched = np.radians([0.0, 180.0, -90.0, 0.0, 0.0, -180.0])
    for k in range(4):
        writer.numbers(RecordKind.JOINTS, stretched, 56.0 * k)
    writer.close(168.0)
    table = torque_table(read_stream(tmp_path / "x"), load_robot("puma560"))
    assert [table[f"tau{j}_Nm"][1] for j in range(1, 7)] == pytest.approx([0, -45.717, -8.483, 0, -0.028, 0], abs=2e-3)
    with pytest.raises(LogError, match="not of 'stanford'"):
        torque_table(read_stream(tmp_path / "x"), load_robot("stanford"))


def test_torques_of_a_joint_that_accelerates_are_its_inertia(tmp_path: Path) -> None:
    """Joint 1 at READY turns with 2 rad/s2: half the torque difference to the turn the other way is its inertia."""
    sums = []
    for a in (2.0, -2.0):
        writer = StreamWriter(tmp_path / "x", StreamStart("puma560", "RRRRRR", "prog", "offl", 20000))
        for k in range(9):
            joints = np.radians([0.0, 90.0, -90.0, 0.0, 0.0, 0.0])
            joints[0] = 0.5 * a * (0.02 * (k - 4)) ** 2
            writer.numbers(RecordKind.JOINTS, joints, 20.0 * k)
        writer.close(160.0)
        sums.append(torque_table(read_stream(tmp_path / "x"), load_robot("puma560"))["tau1_Nm"][4])
    assert 1.0 < (sums[0] - sums[1]) / 4.0 < 3.0  # the rotor alone has 0.78 kg m2, and links stand off the axis
    assert sums[0] == pytest.approx(-sums[1])


def test_too_few_setpoints_have_no_torques(tmp_path: Path) -> None:
    StreamWriter(tmp_path / "x", StreamStart("puma560", "RRRRRR", "prog", "offl", 20000)).close(0.0)
    with pytest.raises(LogError, match="too few"):
        torque_table(read_stream(tmp_path / "x"), load_robot("puma560"))


ODD = [
    *((kind, content) for kind in (2, 3, 6, 7, 10) for content in (b"", b"1234567", np.zeros(5).tobytes())),
    *((kind, np.full(count, np.nan).tobytes()) for kind, count in ((2, 6), (3, 12), (6, 2), (7, 3), (8, 1), (10, 6))),
    (2, np.full(6, np.inf).tobytes()),
    (3, np.full(12, 1e200).tobytes()),
    (3, np.zeros(12).tobytes()),
    (8, b""),
    (8, b"1234"),
    (1, START.encode()),
]


@pytest.mark.parametrize(("kind", "content"), ODD)
def test_a_record_with_a_right_checksum_and_odd_content_is_damage_at_its_byte(
    path: Path, tmp_path: Path, kind: int, content: bytes
) -> None:
    data, chain = path.read_bytes(), headers(path.read_bytes())
    at = chain[4][0]
    odd = packed(kind, content, at, chain[3][0], 56.0)
    end = packed(int(RecordKind.END), b"", at + len(odd), at, 56.0)
    (tmp_path / "odd.arcl").write_bytes(data[:at] + odd + end)
    stream = read_stream(tmp_path / "odd.arcl")
    assert stream.records == read_stream(path).records[:3]
    assert f"damaged at byte {at}: " in stream.damage
    assert f"sound records follow from byte {at + len(odd)} on" in stream.damage
    for table in (joint_table, cartesian_table, lambda stream: list(stream_lines(stream))):
        assert table(stream)


def test_a_time_that_is_no_number_is_damage(path: Path, tmp_path: Path) -> None:
    data, chain = path.read_bytes(), headers(path.read_bytes())
    at = chain[2][0]
    (tmp_path / "t").write_bytes(data[:at] + packed(4, b"request", at, chain[1][0], float("nan")))
    assert f"damaged at byte {at}: a time" in read_stream(tmp_path / "t").damage


def test_a_stream_begins_with_a_start(tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(packed(2, START.encode(), 0, 0, 0.0))
    with pytest.raises(LogError, match="not an ARCL stream"):
        read_stream(tmp_path / "x")
