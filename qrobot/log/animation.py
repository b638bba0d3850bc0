"""A log as moving pictures: the arm in three dimensions beside its tracking errors, drawn without a screen.

The arm is `model.arm_shape`, the same that viewers and the pendant show. Its shadow is where the servo wants it; the
line behind the tool is the way that it has gone.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from mpl_toolkits.mplot3d.axes3d import Axes3D
from numpy.typing import NDArray

from qrobot.arrays import Floats
from qrobot.config import Robot, load_robot
from qrobot.config.document import parse_document
from qrobot.config.robot import robot_of
from qrobot.errors import ConfigError, LogError
from qrobot.log.plot import COLOURS, DASHES, STYLE, thin
from qrobot.log.read import Log
from qrobot.modecodes import Mode
from qrobot.model.arm_shape import ArmCylinder, arm_shape, link_frames, tip_frame

LINK_COLOUR: Final = (0.84, 0.83, 0.78)
JOINT_COLOUR: Final = (0.16, 0.38, 0.62)
GHOST_COLOUR: Final = (0.85, 0.45, 0.10)
WAY_COLOUR: Final = "#D55E00"
SIDES: Final = 16  # of a cylinder
LIGHT: Final = np.array([0.35, -0.55, 0.75])
_WIDTH_IN, _HEIGHT_IN = 9.6, 4.8
SUFFIXES: Final = (".gif", ".mp4")
MOST_FRAMES: Final = 3_000  # [A] two minutes at 25 a second; a GIF of more is of no use to anybody
GHOST_FROM_M: Final = 0.004  # [A] nearer than that the shadow of the setpoint would only flicker

Progress = Callable[[int, int], object]


@dataclass(frozen=True)
class Film:
    """The part of a log to show, how fast, and in how many pictures.

    Attributes:
        begin_s, end_s: seconds since the log's first row; the end may be None.
        speed: seconds of the log in one second of the film.
        frames_hz: pictures a second.
        width: pixels; a picture is half as high.
    """

    begin_s: float = 0.0
    end_s: float | None = None
    speed: float = 1.0
    frames_hz: int = 12
    width: int = 720

    def rows(self, log: Log) -> NDArray[np.intp]:
        """The row of each picture. Raises LogError when there is none, or when they are too many."""
        if not log.rows.size:
            raise LogError(f"{log.path}: no cycles, so nothing can be shown")
        time_s = log.time_s
        end_s = float(time_s[-1]) if self.end_s is None else min(self.end_s, float(time_s[-1]))
        if not self.begin_s < end_s:
            raise LogError(f"{log.path}: nothing from {self.begin_s:g} s to {end_s:g} s; it has {time_s[-1]:.2f} s")
        count = int((end_s - self.begin_s) / self.speed * self.frames_hz) + 1
        if count > MOST_FRAMES:
            raise LogError(f"{count} pictures, {MOST_FRAMES} allowed: show less of the log, or show it faster")
        times = self.begin_s + np.arange(count) * self.speed / self.frames_hz
        return np.searchsorted(time_s, times).clip(0, time_s.size - 1)


def robot_of_log(log: Log) -> Robot:
    """The robot that a log carries in itself, or else the packaged one of its name.

    Raises:
        LogError: neither is there.
    """
    for name, content in log.attachments.items():
        if name.endswith(".toml"):
            document = parse_document(content, name)
            if document.get("name") == log.header.robot and "geometry" in document:
                return robot_of(document, name)
    try:
        return load_robot(log.header.robot)
    except ConfigError as error:
        raise LogError(f"{log.path}: the arm cannot be drawn: {error}") from None


def write_animation(log: Log, path: Path, film: Film, progress: Progress = lambda *_: None) -> None:
    """Write the film of a log; `.gif` or `.mp4` by the suffix.

    Raises:
        LogError: another suffix, no ffmpeg for an `.mp4`, nothing to show, or the file cannot be written.
    """
    writer = _writer(path, film)
    rows = film.rows(log)
    with mpl.rc_context(STYLE):
        stage = _Stage(log, robot_of_log(log), rows)
        try:
            with writer.saving(stage.figure, str(path), film.width / _WIDTH_IN):
                for number, row in enumerate(rows):
                    stage.show(int(row))
                    writer.grab_frame()
                    progress(number + 1, len(rows))
        except OSError as error:
            raise LogError(f"cannot write {path}: {error.strerror or error}") from None


def _writer(path: Path, film: Film) -> AbstractMovieWriter:
    if path.suffix.lower() not in SUFFIXES:
        raise LogError(f"cannot write {path}: a film ends in {' or '.join(SUFFIXES)}")
    if path.suffix.lower() == ".gif":
        return PillowWriter(fps=film.frames_hz)
    if shutil.which("ffmpeg") is None:
        raise LogError("an .mp4 needs ffmpeg (apt install ffmpeg); a .gif needs no other program")
    return FFMpegWriter(fps=film.frames_hz, codec="libx264", extra_args=["-pix_fmt", "yuv420p"])


class _Stage:
    """One figure whose parts move."""

    def __init__(self, log: Log, robot: Robot, rows: NDArray[np.intp]) -> None:
        self._log, self._arm = log, _SolidArm(robot)
        self.figure = Figure(figsize=(_WIDTH_IN, _HEIGHT_IN))
        space: Any = self.figure.add_axes((-0.06, -0.12, 0.68, 1.24), projection="3d")
        self._body, self._shadow = _solid(space, 1.0), _solid(space, 0.22)
        self._line = space.plot([], [], [], color=WAY_COLOUR, linewidth=1.2)[0]
        self._way: list[Floats] = []
        _set_up_space(
            space, self._arm, np.array([self._arm.tip(q) for q in log.rows["q"][rows[:: max(1, rows.size // 50)]]])
        )
        self._caption = self.figure.text(0.02, 0.94, "", fontsize=10, fontweight="bold")
        self._cursor = _set_up_errors(self.figure.add_axes((0.655, 0.27, 0.325, 0.62)), log, rows)

    def show(self, row: int) -> None:
        """Move everything to one row of the log."""
        now = self._log.rows[row]
        place, wanted = self._arm.tip(now["q"]), self._arm.tip(now["q_ref"])
        _put(self._body, *self._arm.faces(now["q"]))
        apart = float(np.linalg.norm(place - wanted)) > GHOST_FROM_M
        faces, colours = self._arm.faces(now["q_ref"], GHOST_COLOUR)
        _put(self._shadow, faces if apart else faces[:0], colours if apart else colours[:0])
        self._way.append(place)
        self._line.set_data_3d(*np.array(self._way).T)
        time_s = float(self._log.time_s[row])
        self._caption.set_text(f"{self._log.header.robot}   {Mode(int(now['mode'])).name}   {time_s:.2f} s")
        self._cursor.set_xdata([time_s, time_s])


class _SolidArm:
    """The faces of an arm's cylinders, wherever its joints are."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self._tip = robot, tip_frame(robot)
        self._parts = [(part, *_cylinder_faces(part)) for part in arm_shape(robot)]

    @cached_property
    def floor_m(self) -> float:
        """Height of the floor in the base frame."""
        return -self.robot.geometry.base_height_m

    def frames(self, q: Sequence[float] | Floats) -> list[Floats]:
        """Base frame and each link's frame in it. Shapes (4, 4)."""
        frames = [np.eye(4)]
        for link in link_frames(self.robot, [float(x) for x in q]):
            frames.append(frames[-1] @ link)
        return frames

    def tip(self, q: Sequence[float] | Floats) -> Floats:
        """The tip of the tool in the base frame, m. Shape (3,)."""
        tip: Floats = (self.frames(q)[-1] @ self._tip)[:3, 3]
        return tip

    def faces(self, q: Sequence[float] | Floats, tint: Sequence[float] | None = None) -> tuple[Floats, Floats]:
        """Corners of all faces, shape (faces, 4, 3), and their colours in this light, shape (faces, 3)."""
        frames = self.frames(q)
        corners, colours = [], []
        for part, faces, normals in self._parts:
            R, p = frames[part.frame][:3, :3], frames[part.frame][:3, 3]
            bright = 0.62 + 0.38 * np.clip(normals @ R.T @ (LIGHT / np.linalg.norm(LIGHT)), -0.6, 1.0)
            corners.append(faces @ R.T + p)
            colours.append(np.outer(bright, tint or (JOINT_COLOUR if part.is_joint else LINK_COLOUR)))
        return np.concatenate(corners), np.clip(np.concatenate(colours), 0.0, 1.0)


def _cylinder_faces(part: ArmCylinder) -> tuple[Floats, Floats]:
    """Faces of a cylinder in its link's frame: corners (faces, 4, 3) and outward normals (faces, 3)."""
    angle = np.arange(SIDES + 1) * 2.0 * np.pi / SIDES
    rim = part.radius * np.column_stack([np.cos(angle), np.sin(angle)])
    half = 0.5 * part.length
    below, above = (np.column_stack([rim, np.full(SIDES + 1, z)]) for z in (-half, half))
    sides = np.stack([below[:-1], below[1:], above[1:], above[:-1]], axis=1)
    middle = 0.5 * (angle[:-1] + angle[1:])
    caps = [np.stack([end[:-1], end[1:], 0.0 * end[1:] + [0, 0, z], 0.0 * end[1:] + [0, 0, z]], axis=1)
            for end, z in ((below, -half), (above, half))]  # fmt: skip
    outward = np.column_stack([np.cos(middle), np.sin(middle), np.zeros(SIDES)])
    normals = np.concatenate([outward, np.tile([0.0, 0.0, -1.0], (SIDES, 1)), np.tile([0.0, 0.0, 1.0], (SIDES, 1))])
    R, p = part.T[:3, :3], part.T[:3, 3]
    return np.concatenate([sides, *caps]) @ R.T + p, normals @ R.T


def _solid(space: Axes3D, alpha: float) -> Poly3DCollection:
    faces = Poly3DCollection([np.zeros((4, 3))], alpha=alpha, linewidths=0.0)
    space.add_collection3d(faces)
    return faces


def _put(solid: Poly3DCollection, faces: Floats, colours: Floats) -> None:
    """Move faces, shape (faces, 4, 3), and colour them."""
    solid.set_visible(bool(len(faces)))
    if len(faces):
        solid.set_verts(list(faces))
        solid.set_facecolor(colours)
        solid.set_edgecolor(colours)


def _set_up_space(space: Axes3D, arm: _SolidArm, way: Floats) -> None:
    """Floor, view and limits that hold the arm and the way of its tool. Shape of `way` (k, 3)."""
    reach = np.vstack([way, *(frame[:3, 3] for frame in arm.frames(arm.robot.poses["ready"])), np.zeros(3)])
    low, high = reach.min(axis=0), reach.max(axis=0)
    low[2] = arm.floor_m
    half = 0.5 * float((high - low).max()) * 1.02
    middle = 0.5 * (low + high)
    space.set_xlim(middle[0] - half, middle[0] + half)
    space.set_ylim(middle[1] - half, middle[1] + half)
    space.set_zlim(low[2], low[2] + 2.0 * half)
    space.set_box_aspect((1.0, 1.0, 1.0), zoom=1.35)
    space.view_init(elev=18.0, azim=-52.0)
    space.set_axis_off()
    for line in np.linspace(-half, half, 9):
        x, y, z = middle[0], middle[1], low[2]
        space.plot([x - half, x + half], [y + line, y + line], [z, z], color="#cccccc", linewidth=0.6)
        space.plot([x + line, x + line], [y - half, y + half], [z, z], color="#cccccc", linewidth=0.6)


def _set_up_errors(axes: Axes, log: Log, rows: NDArray[np.intp]) -> Any:
    """Tracking errors of the joints that turn, or of all where none does; returns the line at the time shown."""
    turning = [j for j in range(log.header.n) if not log.header.is_prismatic(j)] or list(range(log.header.n))
    part = slice(int(rows[0]), int(rows[-1]) + 1)
    for j in turning:
        time_s, error = thin(log.time_s[part], 1e3 * log.tracking_error[part, j])
        dash = DASHES[j // len(COLOURS) % len(DASHES)]
        axes.plot(time_s, error, color=COLOURS[j % len(COLOURS)], linestyle=dash, label=log.header.joint_names[j])
    unit = "mm" if log.header.is_prismatic(turning[0]) else "mrad"
    axes.set_title(f"desired − measured ({unit})", fontsize=10, pad=6)
    axes.set_xlabel("time (s)")
    axes.margins(x=0.0)
    axes.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.46, -0.2), ncols=3, frameon=False)
    return axes.axvline(float(log.time_s[rows[0]]), color="black", linewidth=1.0)
