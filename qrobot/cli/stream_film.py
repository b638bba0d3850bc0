"""An ARCL stream as moving pictures (Corke & Kirkham, section 4 and Figure 6): the arm and the way of its
tool."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from qrobot.arcl.kinematics import kinematics
from qrobot.arcl.stream import RecordKind, Stream
from qrobot.arrays import Floats
from qrobot.cli.motion_stage import MotionStage
from qrobot.config import Robot
from qrobot.errors import LogError
from qrobot.log.animation import Film, Progress, write_film
from qrobot.printable import printable


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


class StreamStage(MotionStage):
    """One figure whose arm moves as the setpoints say.

    Args:
        stream: whose program it is.
        robot: the arm.
        times: of the setpoints, s. Shape (rows,).
        joints: the setpoints, in the convention of the robot's kinematics layer. Shape (rows, n).
        rows: those that will be shown.
    """

    def __init__(self, stream: Stream, robot: Robot, times: Floats, joints: Floats, rows: NDArray[np.intp]) -> None:
        head = f"{printable(stream.start.program)}   {robot.name}"
        super().__init__(head, robot, times, joints + kinematics(robot).zero, rows)
