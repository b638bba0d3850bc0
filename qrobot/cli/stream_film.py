"""An ARCL stream as moving pictures (Corke & Kirkham, section 4 and Figure 6): the arm and the way of its
tool."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from qrobot.arcl.kinematics import kinematics
from qrobot.arcl.stream import RecordKind, Stream
from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import LogError
from qrobot.log.animation import WAY_COLOUR, Film, Progress, write_film
from qrobot.log.arm_drawing import SolidArm, put_faces, set_up_space, solid_faces
from qrobot.printable import printable

_SIZE_IN: Final = (4.8, 4.8)


def write_stream_film(
    stream: Stream, robot: Robot, path: Path, film: Film, progress: Progress = lambda *_: None
) -> None:
    """Write the film of a stream's joint setpoints; `.gif` or `.mp4` by the suffix, square.

    Raises:
        LogError: the stream is another robot's, or as `write_animation`.
    """
    if (stream.start.robot, stream.start.n) != (robot.name, robot.n):
        raise LogError(f"the stream is of {stream.start.robot!r} with {stream.start.n} joints, not of {robot.name!r}")
    times, joints = stream.table(RecordKind.JOINTS, robot.n)
    rows = film.rows(times, "the stream")
    write_film(path, film, rows, lambda: StreamStage(stream, robot, times, joints, rows), progress)


class StreamStage:
    """One figure whose arm moves as the setpoints say.

    Args:
        stream: whose program it is.
        robot: the arm.
        times: of the setpoints, s. Shape (rows,).
        joints: the setpoints, in the convention of the robot's kinematics layer. Shape (rows, n).
        rows: those that will be shown.

    Attributes:
        way: of the tool's tip, m, in the base frame of the robot file; a place for each picture so far.
    """

    def __init__(self, stream: Stream, robot: Robot, times: Floats, joints: Floats, rows: NDArray[np.intp]) -> None:
        self._arm, self._times = SolidArm(robot), times
        self._q = joints + kinematics(robot).zero
        self.figure = Figure(figsize=_SIZE_IN)
        space: Any = self.figure.add_axes((-0.1, -0.12, 1.2, 1.18), projection="3d")
        self._body = solid_faces(space, 1.0)
        self._line = space.plot([], [], [], color=WAY_COLOUR, linewidth=1.2)[0]
        self.way: list[Floats] = []
        set_up_space(space, self._arm, np.array([self._arm.tip(q) for q in self._q[rows[:: max(1, rows.size // 50)]]]))
        self._head = f"{printable(stream.start.program)}   {robot.name}"
        self._caption = self.figure.text(0.03, 0.94, "", fontsize=10, fontweight="bold", parse_math=False)

    def show(self, row: int) -> None:
        """Move everything to one setpoint."""
        q = self._q[row]
        put_faces(self._body, *self._arm.faces(q))
        self.way.append(self._arm.tip(q))
        self._line.set_data_3d(*np.array(self.way).T)
        self._caption.set_text(f"{self._head}   {self._times[row]:.2f} s")
