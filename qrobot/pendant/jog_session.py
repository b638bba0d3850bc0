"""An arm under command of the pendant: it moves while a button of a page is held, and no longer."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import LinkError, MotionError, QRobotError, ServoFault
from qrobot.pendant.held_press import HeldPress, Press
from qrobot.pendant.revocable_link import RevokedError, revocable
from qrobot.rccl.channel import Channel
from qrobot.rccl.connect import open_channel
from qrobot.rccl.database import DataBase
from qrobot.rccl.held_motion import HeldMotion
from qrobot.rccl.jog import fixed_position
from qrobot.rccl.position import Position
from qrobot.rci import LinkFactory

PERIOD_MS = 28.0  # the servo must hear of the button every 70 ms
SILENT: Final = "the arm was braked: nothing was heard of the page that drives for {:.3f} s; press anew to go on"


class JogSession:
    """One command of one arm, to `leave` or to what ends it.

    Args:
        robot: name or file of the robot.
        link: way to its bridge.
        taught: file of places by name.
        ready: called when the arm follows.
        tell: takes a line for people.
        clock: seconds; that of the presses.
        back_mm: how far the arm goes back from what it met, see `Channel.retract`.

    Attributes:
        press: what is held in the page that drives; for other threads.
    """

    def __init__(
        self,
        robot: str,
        link: LinkFactory,
        taught: Path,
        ready: Callable[[], None],
        tell: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
        back_mm: float = 0.0,
    ) -> None:
        self.press, self._back_mm = HeldPress(), back_mm
        self._robot, self._taught = robot, taught
        self._link = revocable(link, lambda: self._leaving)
        self._ready, self._tell, self._clock = ready, tell, clock
        self._leaving = False
        self._load: tuple[float, list[float]] | None = None
        self._arm: Channel | None = None
        self._done: Press | None = None

    def leave(self) -> None:
        """Let go of what is held, bring the arm to rest and end; an arm without power gets none. Returns at once."""
        self.press.end()
        self._leaving = True

    def hand(self, opened: bool) -> None:
        """Open or close the hand; does nothing before the arm follows, or once it is lost: `run` tells why."""
        if (arm := self._arm) is not None:
            with suppress(QRobotError):
                (arm.OPEN if opened else arm.CLOSE)()

    def load(self, mass: float, centre_mm: list[float]) -> None:
        """Tell the servo a load, kg, once nothing is held; told when it reckons with it, or why it does not."""
        self._load = mass, centre_mm

    def run(self) -> None:
        """Take the arm and serve; raises what ends it before its time, see `open_channel`."""
        with suppress(RevokedError), open_channel(self._link, self._robot, PERIOD_MS) as arm:
            self._arm = arm
            try:
                self._serve(arm)
            finally:
                self._arm = None
                self.press.end()

    def _serve(self, arm: Channel) -> None:
        arm.retract(self._back_mm)
        motion = HeldMotion(arm, lambda: self.press.held(self._clock()))
        self.press.end()  # what was held before the arm could follow
        self._ready()
        with motion.watched():
            while not self._leaving:
                arm.waitas(lambda: self._leaving or motion.held is not None or self._load is not None)
                self._take_load(arm)
                if (press := motion.held) is not None and not self._leaving:
                    self._obey(arm.robot, motion, press)
                    arm.waitas(lambda: motion.held is not self._done)

    def _take_load(self, arm: Channel) -> None:
        load, self._load = self._load, None
        if load is None:
            return
        try:
            arm.setload(*load)
            self._tell(f"the servo reckons with {load[0]:g} kg in the hand")
        except MotionError as error:
            self._tell(f"load: {error}")

    def _obey(self, robot: Robot, motion: HeldMotion[Press], press: Press) -> None:
        """Move for as long as a press is held; what cannot be done is told, and the press is dead."""
        try:
            match press.target:
                case "joint":
                    motion.turn_joint(_joint(robot, press.name), press.way, press.share, press.step)
                case "axis":
                    axes = self._axes(press.frame)
                    motion.go_along(press.name, press.way, press.share, press.in_base, press.step, axes)
                case "place":
                    motion.go_to(self._place(press.name), press.share)
                case "guide":
                    raise MotionError("the arm is taken to jog: let go of it, and take it to lead it by hand")
        except (LinkError, ServoFault):
            raise
        except QRobotError as error:
            self._tell(f"not done: {error}")
        self.press.end_of(press)
        self._done = press
        if silence_s := self.press.take_silence():
            self._tell(SILENT.format(silence_s))

    def _axes(self, frame: str) -> Floats | None:
        """Axes of a taught place, columns (3, 3), in the base; None for "". Raises ConfigError: no such place."""
        return DataBase(self._taught).get(frame).value[:3, :3] if frame else None

    def _place(self, name: str) -> Position:
        """A pose of the robot, or one that was taught. Raises ConfigError: there is none."""
        if self._arm is not None and name in self._arm.robot.poses:
            return self._arm.pose(name)
        return fixed_position(name, DataBase(self._taught).get(name).value)


def _joint(robot: Robot, name: str) -> int:
    if not (name.isdecimal() and 0 < int(name) <= robot.n):
        raise MotionError(f"there are joints 1 to {robot.n}, not {name!r}")
    return int(name) - 1
