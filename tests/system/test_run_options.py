"""`qrobot run --lockstep`: with the choices and the log that a running arm has; and whose lines an exception shows."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.cli.motion_stage import MotionStage
from qrobot.cli.run_film import Heard
from qrobot.config import load_robot
from qrobot.errors import LogError
from qrobot.exchange.robot_document import robot_document, robot_text
from qrobot.log.arm_drawing import SolidArm
from qrobot.log.read import read_log
from qrobot.rccl.connect import open_channel
from qrobot.rccl.offline import OfflineLink
from qrobot.rccl.setpoints import read_setpoints

EXAMPLES = Path(__file__).parents[2] / "examples"
SHORT = """
from qrobot import rccl
with rccl.control("puma560", period_ms=28) as arm:
    arm.move(arm.pose("park"))
    arm.waitfor(arm.completed)
"""
TURN = """
from qrobot import rccl
with rccl.control("puma560", period_ms=28) as arm:
    waist, *others = arm.joints
    arm.move(arm.jposition("turned", [waist + 30.0, *others]))
    arm.waitfor(arm.completed)
"""
MINE = """
from qrobot.servo.laws.law import KP, KV, law

@law
def mine(q_ref, v_ref, q, v, gains, gravity, tau):
    for j in range(tau.size):
        tau[j] = gains[KP, j] * (q_ref[j] - q[j]) + gains[KV, j] * (v_ref[j] - v[j]) + gravity[j]
"""
ARM_OF_ITS_OWN = """
[[arm]]
name = "bent"
robot = "bent.toml"
board = { kind = "emulator", start_pose = "park" }
bridge = { host = "127.0.0.1", port = 5600 }
"""


@pytest.fixture(autouse=True)
def here(unpainted: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*words: str) -> int:
    return run_app(make_app("run"), ["run", *words])


def status_of(*words: str) -> int | str | None:
    """Status of a run whose program may end the command."""
    try:
        return run(*words)
    except SystemExit as ended:
        return ended.code


def test_an_example_brings_its_scene(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--lockstep", str(EXAMPLES / "07_guarded_approach.py")) == 0
    assert re.search(r"the table is [\d.]+ mm below", capsys.readouterr().out)


def test_a_run_in_lockstep_has_law_rate_and_log(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "short.py").write_text(SHORT)
    words = ["--law", "computed-torque", "--rate", "2000", "--plant", "mismatched", "--log", "logs/run.mcap"]
    assert run("--lockstep", *words, "short.py") == 0
    log = read_log(here / "logs" / "run.mcap")
    header = log.header
    assert (header.law, header.rate_hz, header.plant, header.clock) == (
        "computed-torque",
        2000.0,
        "mismatched",
        "lockstep",
    )
    assert log.rows.size > 100
    assert set(log.attachments) == {"puma560.toml", "emulator.toml"}
    assert "qrobot log info logs/run.mcap" in capsys.readouterr().err


@pytest.mark.thorough
def test_the_log_of_a_law_of_ones_own_has_one_name_for_it(here: Path) -> None:
    (here / "short.py").write_text(SHORT)
    (here / "mine.py").write_text(MINE)
    assert run("--lockstep", "--law", "mine.py:mine", "--log", "run.mcap", "short.py") == 0
    assert read_log(here / "run.mcap").law_names == ("mine.py:mine",)


def test_the_log_of_a_program_that_fails_is_kept(here: Path) -> None:
    (here / "fails.py").write_text(SHORT + "    raise RuntimeError('mine')\n")
    assert run("--lockstep", "--log", str(here), "fails.py") == 1
    (path,) = here.glob("puma560-*.mcap")
    assert read_log(path).rows.size > 100


@pytest.mark.sampled(1)
@pytest.mark.parametrize("manner", ["--lockstep", "--offline"])
def test_a_film_of_a_run_ends_with_the_arm_where_the_program_has_led_it(
    manner: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In lock-step from a log that nobody keeps; elsewhere the arm as the program heard of it."""
    (here / "turn.py").write_text(TURN)
    assert run(manner, "--record", "films/turn.gif", "turn.py") == 0
    assert "the film is films/turn.gif" in capsys.readouterr().err.replace("\n", "")
    with Image.open(here / "films" / "turn.gif") as film:
        first = np.asarray(film.convert("L"), dtype=float)
        assert film.n_frames > 8
        film.seek(film.n_frames - 1)
        assert np.abs(np.asarray(film.convert("L"), dtype=float) - first).max() > 50.0  # the arm is elsewhere
    assert not list(here.glob("**/*.mcap"))


def test_what_was_heard_of_an_arm_is_where_it_was_and_was_wanted() -> None:
    heard, robot = Heard(), load_robot("puma560")
    with open_channel(heard.links(OfflineLink), "puma560", 28.0) as arm:
        goal = arm.joints
        goal[0] += 10.0
        arm.move(arm.jposition("turned", goal.tolist()))
    times, q, setpoints = heard.table(robot.n)
    assert np.diff(times) == pytest.approx(0.028)
    assert q[-1] - q[0] == pytest.approx(np.radians([10.0, 0, 0, 0, 0, 0]), abs=1e-9)
    assert np.abs(setpoints - q).max() < 0.028 * robot.limits.v_max[0]
    stage = MotionStage("turn", robot, times, q, np.array([0, len(q) - 1]), setpoints)
    stage.show(len(q) - 1)
    assert np.allclose(stage.way[0], SolidArm(robot).tip(q[-1]))


@pytest.mark.thorough
def test_the_film_of_a_program_that_fails_is_made_and_of_one_that_takes_no_arm_it_is_told(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "fails.py").write_text(SHORT + "    raise RuntimeError('mine')\n")
    assert run("--offline", "--record", "fails.gif", "fails.py") == 1
    assert "RuntimeError: mine" in capsys.readouterr().err
    assert (here / "fails.gif").stat().st_size > 0
    (here / "nothing.py").write_text("print('none')\n")
    assert run("--offline", "--record", "nothing.gif", "nothing.py") == 1
    assert "has heard of no arm" in capsys.readouterr().err.replace("\n", " ")


@pytest.mark.sampled(4)
@pytest.mark.parametrize("manner", ["--lockstep", "--offline"])
@pytest.mark.parametrize(
    ("end", "status"),
    [
        ("raise RuntimeError('mine')", 1),
        ("raise SystemExit(0)", 0),
        ("raise SystemExit(3)", 3),
        ("raise SystemExit('no')", "no"),
        ("raise KeyboardInterrupt", 130),
    ],
)
def test_a_film_is_made_however_a_program_ends(
    manner: str, end: str, status: int | str, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def write(path: Path, *_: object) -> None:
        path.write_bytes(b"film")

    monkeypatch.setattr("qrobot.log.animation.write_film", write)
    monkeypatch.setattr("qrobot.log.animation.write_animation", lambda _, *others: write(*others))
    (here / "ends.py").write_text(f"{SHORT}{end}\n")
    assert status_of(manner, "--record", "ends.gif", "ends.py") == status
    assert (here / "ends.gif").stat().st_size > 0


@pytest.mark.sampled(2)
@pytest.mark.parametrize("manner", ["--lockstep", "--offline"])
@pytest.mark.parametrize(
    ("end", "status", "told"),
    [("raise RuntimeError('mine')", 1, "RuntimeError: mine"), ("raise SystemExit(3)", 3, ""), ("", 1, "")],
)
def test_a_film_that_fails_is_told_and_hides_no_error_of_the_program(
    manner: str, end: str, status: int, told: str, here: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    def refuse(*_: object) -> None:
        raise LogError("no film: the disk is full")

    monkeypatch.setattr("qrobot.log.animation.write_film", refuse)
    monkeypatch.setattr("qrobot.log.animation.write_animation", refuse)
    (here / "ends.py").write_text(f"{SHORT}{end}\n")
    assert status_of(manner, "--record", "ends.gif", "ends.py") == status
    said = capsys.readouterr().err
    assert told in said
    assert "no film: the disk is full" in said.replace("\n", " ")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--record", "x.avi", "short.py"), "a film ends in .gif or .mp4"),
        (("--record", "x.mp4", "short.py"), "needs ffmpeg"),
        (("--record", "x.gif", "--deployment", "two_arms", "short.py"), "choose it with --arm"),
    ],
)
def test_a_film_that_cannot_be_made_is_refused_before_anything_runs(
    words: tuple[str, ...], told: str, here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("qrobot.log.animation.shutil.which", lambda _: None)
    (here / "short.py").write_text("open('ran', 'w')\n")
    assert run("--lockstep", *words) in (1, 2)
    assert told in capsys.readouterr().err.replace("\n", " ")
    assert [path.name for path in here.iterdir()] == ["short.py"]


@pytest.mark.parametrize(
    "words", [("--law", "pd"), ("--rate", "2000"), ("--model", "x.toml"), ("--log", "x.mcap"), ("--scene", "peg")]
)
def test_what_only_an_emulated_arm_has_is_refused_elsewhere(
    here: Path, words: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "short.py").write_text(SHORT)
    for other in ((), ("--offline",)):
        assert run(*other, *words, "short.py") == 1
        assert words[0] in capsys.readouterr().err
    assert not (here / "x.mcap").exists()


FAILS = """
import helper
from qrobot.rccl import EQ, TL, control, gentr_trsl, makeposition, newtrans, t6
arm = control("puma560")
arm.setmode("cartesian")
tool = gentr_trsl("TOOL", 0, 0, 100)
arm.move(makeposition("P", t6, tool, EQ, gentr_trsl("A", 500, 100, 0), newtrans("R", helper.turn), TL, tool))
arm.waitfor(arm.completed)
"""
HELPER = """
def turn(t):
    raise RuntimeError("mine")
"""


def test_an_exception_shows_the_frames_of_ones_own_files_alone(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "fails.py").write_text(FAILS)
    (here / "helper.py").write_text(HELPER)
    assert run("--offline", "fails.py") == 1
    told = capsys.readouterr().err
    assert {Path(name).name for name in re.findall(r'File "([^"]+)"', told)} == {"fails.py", "helper.py"}
    assert told.splitlines()[-1] == "RuntimeError: mine"
    assert "--traceback shows them" in told
    assert run("--offline", "--traceback", "fails.py") == 1
    assert "runpy" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["x = (", "\0", "import nothing_of_the_kind", "1 / 0", "open('/nowhere/x')"])
def test_whatever_a_program_raises_has_no_frame_of_ours(
    here: Path, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "fails.py").write_text(text)
    assert run("--offline", "fails.py") == 1
    told = capsys.readouterr().err
    assert not re.search(r"cyclopts|runpy|qrobot/", told)
    assert re.match(r"\w*Error: ", told.splitlines()[-1])


def test_an_error_of_ours_names_the_line_of_the_program(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "fails.py").write_text(SHORT.replace('pose("park")', 'pose("bed")'))
    assert run("--offline", "fails.py") == 1
    assert re.search(r"no pose 'bed'.*\(.*fails\.py, line 4\)$", capsys.readouterr().err.strip())


def test_what_a_program_prints_comes_line_by_line_behind_a_pipe_too(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "tells.py").write_text("import sys\nprint(sys.stdout.line_buffering)\n")
    assert run("--offline", "tells.py") == 0
    assert capsys.readouterr().out == "True\n"


def test_a_star_import_gives_the_names_of_the_library(here: Path) -> None:
    (here / "star.py").write_text("from qrobot.rccl import *\nassert callable(control)\n")
    assert run("--offline", "star.py") == 0


@pytest.mark.thorough
def test_an_arm_without_a_closed_form_traces_the_box_as_a_puma_does(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = robot_text(robot_document(load_robot("puma560"))).replace('family = "puma"', 'family = "generic"')
    text = text.replace('name = "puma560"', 'name = "bent"').replace("-90.0, 0.0, 90.0", "-80.0, 0.0, 90.0", 1)
    (here / "bent.toml").write_text(text)
    (here / "arms.toml").write_text(ARM_OF_ITS_OWN)
    (here / "box.py").write_text((EXAMPLES / "12_box.py").read_text().replace('"puma560"', '"bent.toml"'))
    assert load_robot("bent.toml").geometry.alpha_rad[1] == pytest.approx(np.radians(-80.0))
    assert run("--lockstep", "--deployment", "arms.toml", "--output", "box", "box.py") == 0
    told = re.search(r"at most ([0-9.]+) mm off", capsys.readouterr().err)
    assert told is not None
    assert float(told[1]) < 2.0


@pytest.mark.parametrize("manner", ["--offline", "--lockstep"])
@pytest.mark.parametrize("place", ["ready", "-10,-80,95.5,0,20,1"])
def test_an_arm_that_is_not_there_begins_where_it_is_told_to(here: Path, manner: str, place: str) -> None:
    q_deg = [0, -90, 90, 0, 0, 0] if place == "ready" else [float(each) for each in place.split(",")]
    (here / "turn.py").write_text(TURN)
    assert run(manner, "--start", place, "--output", "out", "turn.py") == 0
    q = np.degrees(read_setpoints(here / "out" / "setpoints.csv").q)
    np.testing.assert_allclose(q[0], q_deg, atol=0.1)
    np.testing.assert_allclose(q[-1] - q[0], (30, 0, 0, 0, 0, 0), atol=1e-6)


ARCL_PLACE = """
from qrobot.arcl import ARCL_ROBOT, arcl_close, arcl_open
rp = arcl_open(ARCL_ROBOT, "puma560", 0)
print("joints", *rp.joints)
arcl_close(rp)
"""
VAL_PLACE = """.PROGRAM main
  HERE #now
  DECOMPOSE x[] = #now
  TYPE "joints", x[0], x[1], x[2], x[3], x[4], x[5]
.END
"""


PLACE_DEG = [-10.0, -80.0, 95.0, 0.0, 20.0, 1.0]
IN_PAULS_CONVENTION = [-10.0, 100.0, -85.0, 0.0, 20.0, -179.0]  # joints 2, 3 and 6 are counted from elsewhere


def joints_told(printed: str) -> list[float]:
    line = next(line for line in printed.splitlines() if line.startswith("joints"))
    return [float(each) for each in line.split()[1:]]


def test_programs_of_arcl_and_val_begin_off_line_where_they_are_told_to(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--offline", f"--start={','.join(map(str, PLACE_DEG))}"]
    (here / "place.py").write_text(ARCL_PLACE)
    assert run(*words, "place.py") == 0
    assert joints_told(capsys.readouterr().out) == pytest.approx(IN_PAULS_CONVENTION)
    (here / "place.v2").write_text(VAL_PLACE)
    for library in ("rccl", "arcl"):
        assert run_app(make_app("val"), ["val", "run", *words, "--library", library, "place.v2"]) == 0
        assert joints_told(capsys.readouterr().out) == pytest.approx(PLACE_DEG)


def test_a_place_is_refused_before_anything_begins(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "turn.py").write_text(TURN)
    two = ["--deployment", "two_arms"]
    for words, told in (
        (["--start", "ready"], "a running arm stands where it is"),
        (["--offline", "--start", "nowhere"], "name a pose of puma560"),
        (["--lockstep", "--start", "1,2"], "each of 6 joints"),
        (["--lockstep", "--start", "ready", *two], "choose it with --arm"),
    ):
        assert run(*words, "turn.py") == 1
        assert told in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("file", "told"),
    [
        ("box.c", "box.c is a source: compile it with `qrobot cc box.c -o box`"),
        ("lab.toml", "`qrobot run --deployment lab.toml PROGRAM`"),
        ("weld.v2", "`qrobot val run weld.v2`"),
        ("way.csv", "`qrobot replay way.csv`"),
        ("way.parquet", "`qrobot replay way.parquet`"),
        ("run.mcap", "`qrobot log info run.mcap`"),
    ],
)
def test_of_a_file_that_is_no_program_it_is_told_what_to_do_with_it(
    file: str, told: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / file).write_bytes(b"")
    assert run("--offline", file) == 1
    assert told in capsys.readouterr().err.replace("\n", " ")
