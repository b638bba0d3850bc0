"""Films of logs: which cycles they show, that the arm stands where kinematics puts it, and what cannot be shown."""

from __future__ import annotations

import os
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from qrobot.cli.run_film import filmed
from qrobot.config import load_robot, robot_path
from qrobot.config.fences import Fence
from qrobot.config.shape import Capsule
from qrobot.errors import LogError
from qrobot.fences.fence_set import FenceSet
from qrobot.fences.told_fences import ToldFences
from qrobot.log.animation import Film, robot_of_log, write_animation
from qrobot.log.arm_drawing import SolidArm
from qrobot.log.fence_drawing import outline
from qrobot.log.fences_of_log import ATTACHMENT, fence_attachments, fences_of_log
from qrobot.log.header import header_for
from qrobot.log.read import Log, read_log
from qrobot.log.record import write_log
from qrobot.model.arm_shape import arm_shape
from qrobot.model.kinematics import forward, kinematics_params
from qrobot.model.transform import transform
from tests.support.log_samples import make_rows

ROBOT = load_robot("puma560")


@pytest.fixture
def log(tmp_path: Path) -> Log:
    """Two seconds at 1 kHz, from READY to END."""
    rows = make_rows(2001, 6)
    rows["t_ns"] = np.arange(2001) * 1_000_000
    share = np.linspace(0.0, 1.0, 2001)[:, None]
    rows["q_ref"] = rows["q"] = (1.0 - share) * ROBOT.poses["ready"] + share * ROBOT.poses["end"]
    rows["mode"] = 5
    return Log(tmp_path / "run.mcap", header_for(ROBOT, 1_000_000, "pd"), rows)


@pytest.mark.parametrize(
    ("film", "times"),
    [
        (Film(frames_hz=4), np.arange(0, 2.01, 0.25)),
        (Film(begin_s=0.5, end_s=1.5, frames_hz=4), np.arange(0.5, 1.51, 0.25)),
        (Film(speed=0.5, frames_hz=4, end_s=0.5), np.arange(0, 0.51, 0.125)),
        (Film(speed=4.0, frames_hz=2), np.array([0.0, 2.0])),
    ],
)
def test_a_film_shows_the_log_at_its_speed(log: Log, film: Film, times: np.ndarray) -> None:
    assert np.allclose(log.time_s[film.rows(log.time_s, "run")], times, atol=0.0011)


def test_every_picture_is_there_and_the_arm_moves(log: Log, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    path = tmp_path / "run.gif"
    write_animation(log, path, Film(frames_hz=2, width=320), lambda done, of: told.append((done, of)))
    with Image.open(path) as film:
        assert (film.n_frames, film.size) == (5, (320, 160))
        assert film.info["duration"] == 500
        pictures = []
        for number in range(5):
            film.seek(number)
            pictures.append(np.asarray(film.convert("L"), dtype=float))
    assert told == [(k, 5) for k in range(1, 6)]
    for before, after in pairwise(pictures):
        assert (np.abs(before - after)[:, :200] > 60).sum() > 100


def test_a_film_that_is_broken_off_leaves_the_one_before(log: Log, tmp_path: Path) -> None:
    path, film = tmp_path / "run.gif", Film(frames_hz=2, width=320)
    path.write_bytes(b"the film before")

    def interrupt(done: int, of: int) -> None:
        if done == of - 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_animation(log, path, film, interrupt)
    assert path.read_bytes() == b"the film before"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("name", ["puma560", "stanford"])
def test_the_arm_stands_where_forward_kinematics_puts_it(name: str) -> None:
    robot = load_robot(name)
    arm, T = SolidArm(robot), np.empty((4, 4))
    for q in robot.poses.values():
        forward(np.array(q), kinematics_params(robot), T)
        flange = (T @ transform(None, [0.0, 0.0, robot.geometry.flange_m]))[:3, 3]
        assert np.allclose(arm.tip(q), flange, atol=1e-12)
        faces, colours = arm.faces(q)
        assert len(faces) == len(colours)
        assert ((colours >= 0.0) & (colours <= 1.0)).all()
        # The middle of the two caps of each cylinder is the middle of the cylinder.
        for part, own in zip(arm_shape(robot), np.split(faces, len(arm_shape(robot))), strict=True):
            middle = (arm.frames(q)[part.frame] @ part.T)[:3, 3]
            assert np.allclose(own[16:].reshape(-1, 3)[2::4].mean(axis=0), middle, atol=1e-12)


def test_a_log_that_carries_its_robot_is_drawn_with_it(log: Log) -> None:
    other = robot_path("puma560").read_bytes().replace(b"flange_m = 0.05625", b"flange_m = 0.25")
    assert robot_of_log(replace(log, attachments={"lab.toml": other})).geometry.flange_m == 0.25
    assert robot_of_log(replace(log, attachments={"emulator.toml": b"x = 1"})).geometry.flange_m == 0.05625
    with pytest.raises(LogError, match=r"cannot be drawn.*nowhere"):
        robot_of_log(replace(log, header=replace(log.header, robot="nowhere")))


TURNED = {"position_m": (0.4, -0.2, 0.3), "rpy_deg": (30.0, 20.0, -40.0)}
FENCES = (
    Fence(name="bench", shape="box", size_m=(0.6, 1.2, 0.1), **TURNED),
    Fence(name="cell", shape="cylinder", keep="in", radius_m=0.9, length_m=2.4, **TURNED),
    Fence(name="wall", shape="plane", **TURNED),
)


@pytest.mark.parametrize("fence", FENCES, ids=lambda fence: fence.name)
def test_the_edges_of_a_fence_lie_on_its_surface_as_the_servo_knows_it(fence: Fence) -> None:
    """A small ball at the origin of link 1, which is that of the base, touches a fence moved there by its edge."""
    edges = np.concatenate(outline(fence))
    assert np.abs(edges - TURNED["position_m"]).max() > 0.5  # in all directions, not one point
    ball = Capsule(name="ball", link=1, from_m=(0.0, 0.0, 0.0), to_m=(0.0, 0.0, 0.0), radius_m=1e-6)
    for x, y, z in edges[:: max(1, len(edges) // 20)]:
        moved = fence.model_copy(update={"position_m": tuple(np.array(fence.position_m) - (x, y, z))})
        robot = ROBOT.model_copy(update={"shape": ROBOT.shape.model_copy(update={"capsules": (ball,), "apart": ()})})
        assert FenceSet(robot, [moved]).distances(ROBOT.poses["park"])[0] == pytest.approx(0.0, abs=1e-5)


def test_a_log_carries_its_fences_and_its_film_shows_them(log: Log, tmp_path: Path) -> None:
    told = ToldFences(fences=FENCES, self_collision=True, self_margin_m=0.01)
    path, *_ = write_log(tmp_path / "fenced.mcap", log.rows, log.header, fence_attachments(told))
    fenced = read_log(path)
    assert (fences_of_log(fenced), fences_of_log(log)) == (told, None)
    pictures = []
    for number, each in enumerate((log, fenced)):
        write_animation(each, tmp_path / f"{number}.gif", Film(frames_hz=1, end_s=0.5, width=480))
        with Image.open(tmp_path / f"{number}.gif") as film:
            pictures.append(np.asarray(film.convert("RGB"), dtype=float))
    changed = np.abs(pictures[0] - pictures[1]).max(axis=2) > 40
    assert changed[:, :300].sum() > 200  # the edges
    assert changed[:, 320:].sum() < changed[:, :300].sum() / 20  # and not across the curves
    with pytest.raises(LogError, match=r"fences\.json in .* is damaged"):
        fences_of_log(replace(log, attachments={ATTACHMENT: b"{"}))


@pytest.mark.parametrize(
    ("film", "name", "told"),
    [
        (Film(), "run.avi", "ends in .gif or .mp4"),
        (Film(begin_s=5.0), "run.gif", "nothing from 5 s"),
        (Film(speed=1e-3), "run.gif", "show it faster"),
        (Film(frames_hz=1, width=240), "file/run.gif", "cannot write"),
    ],
)
def test_what_cannot_be_shown_is_told(log: Log, tmp_path: Path, film: Film, name: str, told: str) -> None:
    (tmp_path / "file").touch()  # where a folder would have to be
    with pytest.raises(LogError, match=told):
        write_animation(log, tmp_path / name, film)


def test_an_mp4_without_ffmpeg_and_a_log_without_cycles_are_told(
    log: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shutil.which", lambda _: None)
    with pytest.raises(LogError, match="apt install ffmpeg"):
        write_animation(log, tmp_path / "run.mp4", Film())
    with pytest.raises(LogError, match="no cycles"):
        write_animation(replace(log, rows=log.rows[:0]), tmp_path / "run.gif", Film())


def put_ffmpeg(script: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a script stand for ffmpeg."""
    (folder / "bin").mkdir()
    program = folder / "bin" / "ffmpeg"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{program.parent}:{os.environ['PATH']}")


@pytest.mark.sampled(1)
@pytest.mark.parametrize("width", [320, 322, 321])
def test_pictures_of_an_mp4_have_even_sides_as_its_colours_need(
    log: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, width: int
) -> None:
    put_ffmpeg(f'echo "$@" > {tmp_path}/asked; for file; do :; done; cat > "$file"', tmp_path, monkeypatch)
    path = tmp_path / "run.mp4"
    write_animation(log, path, Film(frames_hz=2, width=width))
    asked = (tmp_path / "asked").read_text().split()
    sides = [int(side) for side in asked[asked.index("-s") + 1].split("x")]
    assert [side % 2 for side in sides] == [0, 0]
    assert sides == pytest.approx([width, width / 2], abs=1.0)
    assert path.stat().st_size == 5 * 4 * sides[0] * sides[1]  # five pictures in RGBA
    assert asked[-4:-2] == ["-pix_fmt", "yuv420p"]


@pytest.mark.parametrize(
    ("script", "told"),
    [
        ("echo \"Unknown encoder 'h264'\" >&2; echo more >&2; exit 1", "ffmpeg: Unknown encoder 'h264'$"),
        ("cat > /dev/null; exit 3", "ffmpeg: status 3$"),
    ],
)
def test_what_ffmpeg_says_when_it_fails_is_told_and_no_film_is_left(
    log: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str, told: str
) -> None:
    put_ffmpeg(script, tmp_path, monkeypatch)
    (tmp_path / "films").mkdir()
    with pytest.raises(LogError, match=f"run.mp4: {told}"):
        write_animation(log, tmp_path / "films" / "run.mp4", Film(frames_hz=2, width=320))
    assert list((tmp_path / "films").iterdir()) == []


def test_a_film_of_a_program_that_ended_well_and_could_not_be_made_is_told(
    log: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put_ffmpeg("cat > /dev/null; exit 3", tmp_path, monkeypatch)
    make = partial(write_animation, log, tmp_path / "run.mp4", Film(frames_hz=2, width=320))
    with pytest.raises(LogError, match="ffmpeg: status 3"), filmed(make):
        raise SystemExit(0)


def test_a_film_that_is_broken_off_ends_as_such_though_ffmpeg_hears_of_it_and_fails(
    log: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(_done: int, _of: int) -> None:
        raise KeyboardInterrupt

    put_ffmpeg("cat > /dev/null; exit 255", tmp_path, monkeypatch)
    with pytest.raises(KeyboardInterrupt):
        write_animation(log, tmp_path / "run.mp4", Film(frames_hz=2, width=320), interrupt)
    assert not (tmp_path / "run.mp4").exists()
