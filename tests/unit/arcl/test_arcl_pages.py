"""The pages on ARCL: the reader printed on the stream's page works, the calls they name are there."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from qrobot import arcl
from qrobot.arcl.stream import RecordKind, StreamStart, StreamWriter, read_stream
from qrobot.arcl.stream.layout import HEADER, checksum
from qrobot.arcl.stream.layout import RecordKind as Kinds
from tests.support.arcl import forget_programs

DOCS = Path(__file__).parents[3] / "docs"
STREAM_PAGE = (DOCS / "reference/arcl-stream.md").read_text()
READER = STREAM_PAGE.partition("```python\n")[2].partition("```")[0]
CALLS_PAGE = (DOCS / "reference/arcl.md").read_text()


def test_the_reader_printed_on_the_streams_page_reads_a_stream_cut_short(tmp_path: Path) -> None:
    path = tmp_path / "run.arcl"
    writer = StreamWriter(path, StreamStart("puma560", "RRRRRR", "prog", "offl", 56000))
    writer.text(RecordKind.REQUEST, "request pos: t=0", 0.0)
    writer.numbers(RecordKind.JOINTS, np.arange(6.0), 56.0)
    writer.event(4, "pos", 112.0)
    writer.close(112.0)
    path.write_bytes(path.read_bytes()[:-3])
    said = read_by_the_page(path)
    assert re.fullmatch(r"no whole record at byte \d+\n", said.stderr)
    assert [line.split() for line in said.stdout.splitlines()] == [
        ["0.000", "START", "puma560", "RRRRRR", "prog", "offl"],
        ["0.000", "REQUEST", "request", "pos:", "t=0"],
        ["0.056", "JOINTS", *(f"{number:.6f}" for number in range(6))],
        ["0.112", "EVENT", "4", "pos"],
    ]


def test_the_reader_on_the_page_reads_what_a_program_has_left_record_by_record(tmp_path: Path) -> None:
    forget_programs()
    rp = arcl.arcl_open(arcl.ARCL_AMI, "loops", arcl.ARCL_STREAM, str(tmp_path / "run.arcl"))
    arcl.arcl_errproc(lambda *_: arcl.OK)
    arcl.gripper(rp, arcl.GRIP_CLOSE_BY, 40.0)
    arcl.iod_write(arcl.new_iod(rp, arcl.IOD_OUT, 3, 2), 2)
    rp.ami.write_analog(1, 2.5)
    arcl.move(rp, arcl.robot_pos(rp, "ready"), arcl.MOV_TIME, 1500, 0)
    arcl.move(rp, arcl.makeposition(arcl.T6, arcl.EQ, arcl.new_trans_tr("far", 9e3, 0, 0), arcl.TL, arcl.T6), 0)
    arcl.arcl_close(rp)
    forget_programs()
    stream = read_stream(tmp_path / "run.arcl")
    said = read_by_the_page(tmp_path / "run.arcl")
    lines = [line.split(maxsplit=2) for line in said.stdout.splitlines()]
    assert (said.returncode, said.stderr) == (0, "")
    assert [(f"{record.t_ms / 1e3:.3f}", RecordKind(record.kind).name) for record in stream.records] == [
        (time, name) for time, name, *_ in lines[1:]
    ]
    assert {name for _, name, *_ in lines} == {kind.name for kind in RecordKind}
    read = np.array([line[2].split() for line in lines if line[1] == "JOINTS"], dtype=float)
    assert np.abs(read - stream.table(RecordKind.JOINTS, 6)[1]).max() <= 0.5e-6
    assert sum(1 for line in READER.splitlines() if line) <= 50


def read_by_the_page(path: Path) -> subprocess.CompletedProcess[str]:
    (path.parent / "reader.py").write_text(READER)
    return subprocess.run(
        [sys.executable, path.parent / "reader.py", path], capture_output=True, text=True, check=False, timeout=60
    )


def circle() -> bytes:
    """A record whose header behind is its own, with a right checksum."""
    header = HEADER.pack(b"ARCL", 4, 0, 8, 0, 0, 0, 0.0)
    return header[:12] + checksum(header, b"a record").to_bytes(4, "little") + header[16:] + b"a record"


@pytest.mark.parametrize("content", [b"", b"just a text\n" * 20, circle()])
def test_the_reader_on_the_page_says_what_is_no_stream_and_always_ends(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "x").write_bytes(content)
    said = read_by_the_page(tmp_path / "x")
    assert (said.returncode, said.stdout, said.stderr) == (1, "", "no whole record at byte 0\n")


def test_the_streams_page_lists_every_kind_of_record() -> None:
    listed = dict(re.findall(r"^\| (\d+) \| ([A-Z]+) \|", STREAM_PAGE, re.MULTILINE))
    assert listed == {str(int(kind)): kind.name for kind in Kinds}


def test_everything_that_the_package_offers_is_there_and_on_its_page() -> None:
    assert [name for name in arcl.__all__ if not hasattr(arcl, name)] == []
    helpers = {"ERROR", "Event", "MotionFeedback"}
    missing = [name for name in arcl.__all__ if not re.search(rf"\b{name}\b", CALLS_PAGE) and name not in helpers]
    assert missing == []
