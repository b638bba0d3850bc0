"""`qrobot arcl`, and `qrobot run` of an ARCL program, off line."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from qrobot.arcl.stream import RecordKind, StreamStart, StreamWriter, read_stream
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.cli.stream_film import StreamStage
from qrobot.config import load_robot
from qrobot.log.arm_drawing import SolidArm
from tests.support.arcl import EXAMPLES

pytestmark = pytest.mark.usefixtures("arcl_alone")

PROGRAM = """
import sys
from qrobot.arcl import ARCL_ARGCV, MOV_TIME, arcl_open, joint_pos, move

rp = arcl_open(ARCL_ARGCV, len(sys.argv), sys.argv, 0)
print("arguments", sys.argv[1:])
move(rp, joint_pos(rp, "away", (20, 120, -10, 10, 60, -160)), MOV_TIME, 1500, 0)
"""


@pytest.fixture
def stream(tmp_path: Path) -> Path:
    writer = StreamWriter(tmp_path / "run.arcl", StreamStart("puma560", "RRRRRR", "pro\x1bg", "offl", 56000))
    for k in range(4):
        writer.numbers(RecordKind.JOINTS, np.radians([10.0 * k, 90.0, -90.0, 0.0, 0.0, 0.0]), 56.0 * k)
        writer.pose(np.eye(4), 56.0 * k)
    writer.close(168.0)
    return tmp_path / "run.arcl"


def say(*words: object) -> int:
    name, *rest = map(str, words)
    return run_app(make_app(name), [name, *rest])


def test_a_stream_is_printed_without_what_a_terminal_would_obey(
    stream: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert say("arcl", "unstream", stream) == 0
    said = capsys.readouterr().out
    assert said.count("joints") == 4
    assert "\x1b" not in said


@pytest.mark.parametrize(
    ("words", "head"),
    [
        (("jtraj",), ["t_s", "j1_deg"]),
        (("ctraj",), ["t_s", "x_mm"]),
        (("ctraj", "--as", "quat"), ["t_s", "x_mm"]),
        (("torques",), ["t_s", "tau1_Nm"]),
    ],
)
def test_tables_go_to_the_terminal_or_into_a_file(
    stream: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], head: list[str]
) -> None:
    assert say("arcl", *words, stream) == 0
    lines = capsys.readouterr().out.splitlines()
    assert (lines[0].split()[:2], len(lines)) == (head, 5)
    assert say("arcl", *words, stream, "--output", tmp_path / "table.csv") == 0
    assert (tmp_path / "table.csv").read_text().splitlines()[0].split(",")[:2] == head
    assert "4 rows" in capsys.readouterr().err


def test_a_stream_cut_short_is_read_and_told(stream: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stream.write_bytes(stream.read_bytes()[:-90])
    assert say("arcl", "jtraj", stream) == 1
    said = capsys.readouterr()
    assert len(said.out.splitlines()) == 5
    assert re.search(r"damaged at byte \d+: no whole record; \d+ bytes are left, and no sound record", said.err)


@pytest.mark.parametrize(
    "words",
    [
        ("unstream", "none"),
        ("jtraj", "{}", "--output", "x.xls"),
        ("ctraj", "{}", "--as", "x"),
        ("torques", "{}", "--robot", "stanford"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(
    stream: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, tmp_path
) -> None:
    monkeypatch.chdir(tmp_path)
    assert say("arcl", *(word.format(stream) for word in words)) in (1, 2)
    assert "Traceback" not in capsys.readouterr().err


def test_a_program_that_simply_ends_has_its_motions_done_and_leaves_its_stream(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "prog.py").write_text(PROGRAM)
    assert say("run", "--offline", "--output", tmp_path / "out", tmp_path / "prog.py", "+m", "part") == 0
    said = capsys.readouterr().out
    assert "arguments ['part']" in said
    assert "request away: t=0, traj=1, Ta=100, Tseg=1500, Vt=0, Vr=0" in said
    stream = read_stream(tmp_path / "out/puma560.arcl")
    _, joints = stream.table(RecordKind.JOINTS, 6)
    assert np.allclose(np.degrees(joints[-1]), [20, 120, -10, 10, 60, -160])
    assert (stream.start.program, stream.damage) == ("prog.py", "")


@pytest.mark.parametrize("mistake", ["1 / 0", 'move(rp, joint_pos(rp, "far", (170, 0, 0, 0, 0, 0)), 0)', "sys.exit(3)"])
def test_a_program_that_fails_is_told_and_its_stream_ends_well(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], mistake: str
) -> None:
    (tmp_path / "prog.py").write_text(PROGRAM + mistake + "\n")
    try:
        status = say("run", "--offline", "--output", tmp_path / "out", tmp_path / "prog.py")
    except SystemExit as error:
        status = error.code
    assert status
    assert read_stream(tmp_path / "out/puma560.arcl").damage == ""


def test_the_papers_program_runs_off_line_by_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert say("run", "--offline", "--output", tmp_path, EXAMPLES / "s13_two_arms.py") == 0
    assert [path.name for path in sorted(tmp_path.glob("*.arcl"))] == ["puma560-2.arcl", "puma560.arcl"]
    assert capsys.readouterr().out.count("enters") == 2


def test_a_film_of_a_stream_shows_the_arm_where_its_setpoints_are(
    stream: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.gif"
    assert say("arcl", "animate", stream, "--fps", 18, "--width", 240) == 0
    assert "run.gif" in capsys.readouterr().err
    with Image.open(path) as film:
        assert (film.n_frames, film.size) == (4, (240, 240))
        first = np.asarray(film.convert("L"), dtype=float)
        film.seek(3)
        assert np.abs(np.asarray(film.convert("L"), dtype=float) - first).max() > 50.0
    robot, read = load_robot("puma560"), read_stream(stream)
    stage = StreamStage(read, robot, *read.table(RecordKind.JOINTS, 6), np.arange(4))
    stage.show(0)  # READY of the robot file, as ARCL's programs see it
    assert np.allclose(stage.way[0], SolidArm(robot).tip(robot.poses["ready"]), atol=1e-9)


@pytest.mark.parametrize(
    ("words", "status", "told"),
    [(("--output", "x.avi"), 2, "a film ends in"), (("--robot", "stanford"), 1, "not of 'stanford'"),
     (("--speed", "0.01", "--fps", "60"), 1, None)],
)  # fmt: skip
def test_what_cannot_be_filmed_is_told(
    stream: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], status: int, told: str | None
) -> None:
    if told is None:
        stream.write_bytes(stream.read_bytes()[:100])  # its first record alone
        told = "nothing can be shown"
    assert say("arcl", "animate", stream, *words) == status
    assert told in capsys.readouterr().err
