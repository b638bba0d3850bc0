"""A wait on virtual time that nothing can end any more: no arm moves, and none is going to."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from qrobot.arcl.opened import open_robots
from qrobot.errors import MotionError
from qrobot.units import S_PER_MS

if TYPE_CHECKING:
    from qrobot.arcl.robot import ArclRobot

IDLE_SAMPLES: Final = 100  # in which no arm has a motion
HELD_S: Final = 120.0  # [A] in which no arm moves, but motions are held back by MOVE_STOP


class Standstill:
    """Watches one wait of a program.

    Args:
        robot: that the program waits for. In real time somebody outside may end the waiting, so nothing is watched.
    """

    def __init__(self, robot: ArclRobot) -> None:
        self._robot = robot
        self._samples = 0
        self._since_ms = robot.ami.treal()

    def check(self) -> None:
        """Count a sample. Raises MotionError: nothing is left that could end this waiting."""
        if not self._robot.ami.virtual_time:
            return
        robots = [robot for robot in {*open_robots(), self._robot} if robot.ami.error is None]
        if any(robot.moving for robot in robots):
            self._samples, self._since_ms = 0, self._robot.ami.treal()
            return
        self._samples += 1
        held = sorted(robot.name for robot in robots if robot.held)
        if not held and self._samples > IDLE_SAMPLES:
            raise MotionError(f"{self._robot.name}: no motion is left that could end this waiting")
        if held and (self._robot.ami.treal() - self._since_ms) * S_PER_MS > HELD_S:
            raise MotionError(
                f"{self._robot.name}: no arm has moved for {HELD_S:g} s of virtual time; motions of "
                f"{', '.join(held)} are held back by MOVE_STOP for ever: does a semaphore stay taken after EVENT_STOP?"
            )
