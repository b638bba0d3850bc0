"""An arm of RCCL below the interpreter: `MOVE` is `move`, in joint or Cartesian mode."""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.motion import TURN_PER_MM, Termination
from qrobot.rccl import EQ, TL, Channel, Position, const, makeposition, t6
from qrobot.rccl.transforms import made_transform
from qrobot.units import DEG_PER_RAD, S_PER_MS
from qrobot.val.arm import Destination
from qrobot.val.library_arm import LibraryArm, MotionUnderWay
from qrobot.wire import JointMode

_WORDS: Final = {
    Termination.JOINT_LIMIT: "a joint would leave its range",
    Termination.UNREACHABLE: "out of reach",
    Termination.SINGULAR: "too near a singular place",
    Termination.TOO_FAST: "a joint would be too fast; it needs a lower SPEED",
    Termination.FENCE: "too near a fence",
}


class RcclArm(LibraryArm[Position]):
    """A `ValArm` over a channel of RCCL.

    Args:
        channel: under control.
    """

    def __init__(self, channel: Channel) -> None:
        super().__init__()
        self.robot = channel.robot
        self._channel = channel
        channel.keep_path()
        self._radians = np.where(self.robot.prismatic, S_PER_MS, 1.0 / DEG_PER_RAD)  # of mm and degrees

    @property
    def time_s(self) -> float:
        """See `ValArm`."""
        return self._channel.time * S_PER_MS

    @property
    def q(self) -> Floats:
        """See `ValArm`."""
        return np.asarray(self._channel.how.q, dtype=np.float64)

    @property
    def setpoint(self) -> Floats:
        """See `ValArm`; a joint that is not told a position is where it is measured."""
        told = np.array(self._channel.chg.modes) == JointMode.POSITION
        return np.where(told, self._channel.chg.setpoints, self.q)

    @property
    def inputs(self) -> int:
        """See `ValArm`."""
        return self._channel.how.inputs

    @property
    def outputs(self) -> int:
        """See `ValArm`."""
        return self._channel.chg.outputs

    @property
    def kept(self) -> str:
        """See `ValArm`."""
        return self._channel.kept

    @property
    def off_path(self) -> bool:
        """See `ValArm`."""
        return self._channel.off_path

    @property
    def waiting(self) -> int:
        """See `ValArm`."""
        return self._channel.nbrequest

    def move(self, destination: Destination) -> None:
        """See `ValArm`."""
        channel, self._rest_since_s = self._channel, None
        channel.setmode("cartesian" if destination.straight else "joint")
        if destination.speed_mm_s is None:
            channel.setjvel(share=destination.share)
        else:
            channel.setvel(destination.speed_mm_s, TURN_PER_MM * destination.speed_mm_s)
        channel.setconf(destination.letters)
        position = self._position(destination)
        channel.move(position)
        self._look()
        self._going.append(MotionUnderWay(destination, position))

    def stop(self) -> None:
        """See `ValArm`."""
        self._rest_since_s = None
        self._channel.stop()

    def pause(self) -> None:
        """See `ValArm`."""
        self._channel.pause()

    def resume(self) -> None:
        """See `ValArm`."""
        self._channel.resume()

    def hand(self, opened: bool) -> None:
        """See `ValArm`."""
        if opened:
            self._channel.OPEN()
        else:
            self._channel.CLOSE()

    def signal(self, *lines: int) -> None:
        """See `ValArm`."""
        self._channel.signal(*lines)

    def analog(self, output: int, volts: float) -> None:
        """See `ValArm`."""
        self._channel.analog(output, volts)

    def payload(self, kg: float, centre_mm: tuple[float, ...]) -> None:
        """See `ValArm`."""
        self._channel.setload(kg, centre_mm)

    def collision(self, reaction: str, thresholds: Floats | None) -> None:
        """See `ValArm`."""
        self._channel.collision(reaction, None if thresholds is None else thresholds.tolist())

    def retract(self, mm: float) -> None:
        """See `ValArm`."""
        self._channel.retract(mm)

    def sample(self) -> None:
        """See `ValArm`."""
        before = self._channel.how.t_ns
        self._channel.waitas(lambda: self._channel.how.t_ns != before)

    def _position(self, destination: Destination) -> Position:
        if destination.q is not None:
            return self._channel.jposition(destination.name, (destination.q / self._radians).tolist())
        if destination.T_robot_tool is None:
            raise ValueError(f"{destination.name} has neither joints nor a pose")
        goal = made_transform(destination.name, const, destination.T_robot_tool)
        tool = made_transform("TOOL", const, destination.T_last_tool)
        return makeposition(destination.name, t6, tool, EQ, goal, TL, tool)

    def _moves(self) -> bool:
        return self._channel.completed.count == 0

    def _set_override(self, percent: float) -> None:
        self._channel.override(percent)

    def _look(self) -> None:
        going = []
        for each in self._going:
            if each.motion.end.count == 0:
                going.append(each)
            elif each.motion.code != Termination.COMPLETED:
                self._stopped.append(each.destination)
                if reason := each.motion.why or _WORDS.get(Termination(each.motion.code)):
                    self._failure = self._failure or f"the motion to {each.destination.name} ended: {reason}"
        self._going = going
