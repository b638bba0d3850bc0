"""Recordings of an arm that was led by hand, written by a thread: smoothing takes long, and nothing waits for it."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Final

from qrobot.config import load_robot
from qrobot.errors import QRobotError
from qrobot.pendant.free_path import write_beside
from qrobot.rccl.recordings import joined, smoothed
from qrobot.rccl.setpoint_tables import write_setpoint_table
from qrobot.rccl.setpoints import Setpoints

_log: Final = logging.getLogger(__name__)


class RecordingWriter:
    """Writes recordings of one arm, one after the other.

    Args:
        robot: name or file of the robot.
        tell: takes a line for people when one is written, or cannot be; from any thread.
    """

    def __init__(self, robot: str, tell: Callable[[str], None]) -> None:
        self._robot, self._tell = robot, tell
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="recordings")
        self._under_way: list[Future[str]] = []

    @property
    def writes(self) -> bool:
        """Something is not written yet."""
        return any(not each.done() for each in self._under_way)

    def write(self, led: Sequence[Setpoints], folder: Path, name: str, smooth_m: float) -> None:
        """Write recordings as one, smoothed within so many m, 0 for as it was. Returns at once.

        Args:
            name: of the file, without number and suffix; see `write_beside`.
        """
        one = self._thread.submit(self._write_now, tuple(led), folder, name, smooth_m)
        self._under_way = [*(each for each in self._under_way if not each.done()), one]
        one.add_done_callback(lambda done: self._tell(done.result()))

    def close(self) -> None:
        """Wait until everything is written; nothing may be asked for afterwards."""
        self._thread.shutdown()

    def _write_now(self, led: Sequence[Setpoints], folder: Path, name: str, smooth_m: float) -> str:
        try:
            robot = load_robot(self._robot)
            motion = joined(led, robot)
            motion = smoothed(motion, robot, smooth_m) if smooth_m else motion
            path = write_beside(folder, name, ".csv", lambda path: write_setpoint_table(path, motion))
        except QRobotError as error:
            return f"the recording is not written: {error}"
        except Exception as error:  # nobody asks the thread how it went
            _log.exception("a recording of %s could not be written", self._robot)
            return f"the recording is not written: {type(error).__name__}"
        return f"wrote {path}: the tab Programs plays it, and so does `qrobot replay {path} --approach`"
