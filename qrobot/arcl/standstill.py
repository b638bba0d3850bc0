"""A wait on virtual time that nothing can end any more: no arm moves, and none is going to."""

from __future__ import annotations

from typing import TYPE_CHECKING

from qrobot.arcl.opened import open_robots
from qrobot.errors import MotionError
from qrobot.rci.standstill import HELD_S, Standstill, nobody_resumes
from qrobot.units import S_PER_MS

if TYPE_CHECKING:
    from qrobot.arcl.robot import ArclRobot


class ArclStandstill:
    """Watches one wait of a program.

    Args:
        robot: that the program waits for. In real time somebody outside may end the waiting, so nothing is watched.
    """

    def __init__(self, robot: ArclRobot) -> None:
        self._robot, self._stands = robot, Standstill()

    def check(self) -> None:
        """Look once more. Raises MotionError: nothing is left that could end this waiting."""
        if not self._robot.ami.virtual_time:
            return
        robots = [robot for robot in {*open_robots(), self._robot} if robot.ami.error is None]
        moving = any(robot.moving and not robot.halted for robot in robots)
        if not self._stands.lasts(self._robot.ami.treal() * S_PER_MS, moving):
            return
        for robot in robots:
            if robot.halted:
                raise nobody_resumes(robot.name, robot.halted)
        still = f"{self._robot.name}: no arm has moved for {HELD_S:g} s of virtual time"
        if not (held := sorted(robot.name for robot in robots if robot.held)):
            raise MotionError(f"{still}, and no motion is left that could end this waiting")
        raise MotionError(
            f"{still}; motions of {', '.join(held)} are held back by MOVE_STOP for ever: does a semaphore stay taken "
            "after EVENT_STOP?"
        )
