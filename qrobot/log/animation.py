"""A log as moving pictures: the arm in three dimensions beside its tracking errors, drawn without a screen.

The arm is `model.arm_shape`, the same that viewers and the pendant show. Its shadow is where the servo wants it; the
line behind the tool is the way that it has gone. Fences that the log carries stand round it.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, NoReturn, Protocol

import matplotlib as mpl
import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from qrobot.arrays import Floats
from qrobot.config import Robot, load_robot
from qrobot.config.document import parse_document
from qrobot.config.robot import robot_of
from qrobot.errors import ConfigError, LogError, error_text
from qrobot.log.arm_drawing import SolidArm, put_faces, set_up_space, solid_faces
from qrobot.log.fence_drawing import draw_fences, near_points
from qrobot.log.fences_of_log import fences_of_log
from qrobot.log.plot import COLOURS, DASHES, STYLE, thin
from qrobot.log.read import Log
from qrobot.modecodes import Mode
from qrobot.whole_file import written_whole

GHOST_COLOUR: Final = (0.85, 0.45, 0.10)
WAY_COLOUR: Final = "#D55E00"
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

    @classmethod
    def of_all(cls, length_s: float) -> Film:
        """A film of `length_s` s at their speed, or so fast that it is no longer than a film may be."""
        film = cls()
        return replace(film, speed=max(1.0, length_s * film.frames_hz / (MOST_FRAMES - 1)))

    def rows(self, time_s: Floats, what: str) -> NDArray[np.intp]:
        """The row of each picture. Raises LogError when there is none, or when they are too many.

        Args:
            time_s: of all rows, ascending from 0. Shape (rows,).
            what: name of what is shown, for people.
        """
        if not time_s.size:
            raise LogError(f"{what}: no cycles, so nothing can be shown")
        end_s = float(time_s[-1]) if self.end_s is None else min(self.end_s, float(time_s[-1]))
        if not self.begin_s < end_s:
            raise LogError(f"{what}: nothing from {self.begin_s:g} s to {end_s:g} s; it has {time_s[-1]:.2f} s")
        count = int((end_s - self.begin_s) / self.speed * self.frames_hz) + 1
        if count > MOST_FRAMES:
            raise LogError(f"{count} pictures, {MOST_FRAMES} allowed: show less of it, or show it faster")
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
        LogError: another suffix, no ffmpeg for an `.mp4` or one that fails, nothing to show, damaged fences, or the
            file cannot be written.
    """
    rows = film.rows(log.time_s if log.rows.size else np.empty(0), str(log.path))
    write_film(path, film, rows, lambda: _Stage(log, robot_of_log(log), rows), progress)


class FilmStage(Protocol):
    """One figure whose parts move."""

    figure: Figure

    def show(self, row: int) -> None:
        """Move everything to one row of what is shown."""


def write_film(
    path: Path,
    film: Film,
    rows: NDArray[np.intp],
    make_stage: Callable[[], FilmStage],
    progress: Progress = lambda *_: None,
) -> None:
    """Write the pictures of these rows. Raises LogError as `write_animation` does."""
    writer, before = _writer(path, film), sys.exception()  # before: of a program that has ended, whose film it is
    with mpl.rc_context(STYLE):
        stage = make_stage()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            dpi = film.width / stage.figure.get_figwidth()
            with written_whole(path, path.suffix) as place, writer.saving(stage.figure, str(place), dpi):
                for number, row in enumerate(rows):
                    stage.show(int(row))
                    writer.grab_frame()
                    progress(number + 1, len(rows))
        except OSError as error:
            raise LogError(f"cannot write {path}: {error_text(error)}") from None
        except subprocess.CalledProcessError as error:
            _raise_end_of_ffmpeg(error, path, before)


def _raise_end_of_ffmpeg(error: subprocess.CalledProcessError, path: Path, before: BaseException | None) -> NoReturn:
    """Raise what has ended the drawing, Ctrl-C say, which ffmpeg hears too; LogError where ffmpeg itself has failed."""
    ended = error.__context__
    if not (ended is None or ended is before or isinstance(ended, OSError)):  # a broken pipe comes of ffmpeg's end
        raise ended
    told = [*str(error.stderr).strip().splitlines(), f"status {error.returncode}"]
    raise LogError(f"cannot write {path}: ffmpeg: {told[0]}") from None


def check_film_file(path: Path) -> None:
    """Raise LogError when no film can have that name: another suffix, or no ffmpeg for an `.mp4`."""
    if path.suffix.lower() not in SUFFIXES:
        raise LogError(f"cannot write {path}: a film ends in {' or '.join(SUFFIXES)}")
    if path.suffix.lower() != ".gif" and shutil.which("ffmpeg") is None:
        raise LogError("an .mp4 needs ffmpeg (apt install ffmpeg); a .gif needs no other program")


def _writer(path: Path, film: Film) -> AbstractMovieWriter:
    check_film_file(path)
    if path.suffix.lower() == ".gif":
        return PillowWriter(fps=film.frames_hz)
    # With this name Matplotlib makes pictures of even sides, which yuv420p needs, and ffmpeg takes the encoder it has.
    return FFMpegWriter(fps=film.frames_hz, codec="h264", extra_args=["-pix_fmt", "yuv420p"])


class _Stage:
    """One figure whose parts move."""

    def __init__(self, log: Log, robot: Robot, rows: NDArray[np.intp]) -> None:
        self._log, self._arm = log, SolidArm(robot)
        self.figure = Figure(figsize=(_WIDTH_IN, _HEIGHT_IN))
        space: Any = self.figure.add_axes((-0.06, -0.12, 0.68, 1.24), projection="3d")
        self._body, self._shadow = solid_faces(space, 1.0), solid_faces(space, 0.22)
        self._line = space.plot([], [], [], color=WAY_COLOUR, linewidth=1.2)[0]
        self._way: list[Floats] = []
        told = fences_of_log(log)
        fences = () if told is None else told.fences
        way = [self._arm.tip(q) for q in log.rows["q"][rows[:: max(1, rows.size // 50)]]]
        set_up_space(space, self._arm, np.vstack([*way, *near_points(fences)]))
        draw_fences(space, fences)
        self._caption = self.figure.text(0.02, 0.94, "", fontsize=10, fontweight="bold")
        self._cursor = _set_up_errors(self.figure.add_axes((0.655, 0.27, 0.325, 0.62)), log, rows)

    def show(self, row: int) -> None:
        """Move everything to one row of the log."""
        now = self._log.rows[row]
        place, wanted = self._arm.tip(now["q"]), self._arm.tip(now["q_ref"])
        put_faces(self._body, *self._arm.faces(now["q"]))
        apart = float(np.linalg.norm(place - wanted)) > GHOST_FROM_M
        faces, colours = self._arm.faces(now["q_ref"], GHOST_COLOUR)
        put_faces(self._shadow, faces if apart else faces[:0], colours if apart else colours[:0])
        self._way.append(place)
        self._line.set_data_3d(*np.array(self._way).T)
        time_s = float(self._log.time_s[row])
        self._caption.set_text(f"{self._log.header.robot}   {Mode(int(now['mode'])).name}   {time_s:.2f} s")
        self._cursor.set_xdata([time_s, time_s])


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
