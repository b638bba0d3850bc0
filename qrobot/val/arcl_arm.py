"""An arm of ARCL below the interpreter: `MOVE` is `move` with TRAJ_JOINT, `MOVES` with TRAJ_CART."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, Final

from qrobot.arcl import (
    ARCL_PERIOD,
    ARCL_ROBOT,
    EQ,
    GRIP_CLOSE,
    GRIP_OPEN,
    MOV_CONFIG,
    MOV_SHARE,
    MOV_TIME,
    MOV_TRAJ,
    MOV_VR,
    MOV_VT,
    T6,
    TL,
    TRAJ_CART,
    TRAJ_JOINT,
    Event,
    Motion,
    Pos,
    arcl_errproc,
    arcl_open,
    makeposition,
)
from qrobot.arcl.events import CallbackAnswer
from qrobot.arcl.machine import MachineSample
from qrobot.arcl.opened import forget
from qrobot.arcl.robot import ArclRobot
from qrobot.arcl.trans import new_trans_value
from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import LinkError, QRobotError
from qrobot.model.arm import Arm
from qrobot.model.transform import inverse
from qrobot.motion import TURN_PER_MM
from qrobot.units import S_PER_MS
from qrobot.val.arm import Destination
from qrobot.val.library_arm import LibraryArm, MotionUnderWay

STOP_MS: Final = 1  # as soon as the arm can


class ArclArm(LibraryArm[Motion]):
    """A `ValArm` over a robot that ARCL has opened; its errors come here, by `arcl_errproc`.

    Args:
        robot: the arm.
        rp: open.
    """

    def __init__(self, robot: Robot, rp: ArclRobot) -> None:
        super().__init__()
        self.robot = robot
        self._rp, self._zero = rp, rp.aki.zero
        self._T_arcl_base = rp.aki.forward(rp.aki.zero * 0.0) @ inverse(Arm(robot).forward(rp.aki.zero))
        self._outputs = rp.lines[1]
        arcl_errproc(self._note)
        rp.keep_path()
        rp.expect_more()  # else each motion would be faster than its SPEED, by the time of its transitions

    @property
    def time_s(self) -> float:
        """See `ValArm`."""
        return self._rp.treal * S_PER_MS

    @property
    def q(self) -> Floats:
        """See `ValArm`; setpoints of ARCL count from joint positions of its own."""
        q: Floats = self._seen.q + self._zero
        return q

    @property
    def setpoint(self) -> Floats:
        """See `ValArm`."""
        q: Floats = self._rp.setpoint + self._zero
        return q

    @property
    def inputs(self) -> int:
        """See `ValArm`."""
        return self._seen.inputs

    @property
    def outputs(self) -> int:
        """See `ValArm`; those that were switched last are not in the newest sample yet."""
        return self._outputs

    @property
    def kept(self) -> str:
        """See `ValArm`."""
        return self._rp.kept

    @property
    def off_path(self) -> bool:
        """See `ValArm`."""
        return self._rp.off_path

    @property
    def waiting(self) -> int:
        """See `ValArm`."""
        self._look()
        return sum(not going.motion.begun for going in self._going)

    def move(self, destination: Destination) -> None:
        """See `ValArm`. ARCL tells what cannot be done when its turn comes, so it is asked before."""
        pos, attributes = self._position(destination), _attributes(destination)
        self._rp.judge(pos, *attributes)
        self._rest_since_s = None
        self._look()
        self._going.append(MotionUnderWay(destination, self._rp.move(pos, *attributes)))

    def stop(self) -> None:
        """See `ValArm`."""
        self._rest_since_s = None
        self._rp.stop(MOV_TIME, STOP_MS)

    def pause(self) -> None:
        """See `ValArm`."""
        self._rp.pause()

    def resume(self) -> None:
        """See `ValArm`."""
        self._rp.resume()

    def hand(self, opened: bool) -> None:
        """See `ValArm`."""
        self._rp.gripper(GRIP_OPEN if opened else GRIP_CLOSE)

    def signal(self, *lines: int) -> None:
        """See `ValArm`."""
        for line in lines:
            self._rp.write_outputs(abs(line), 1, int(line > 0))
            bit = 1 << (abs(line) - 1)
            self._outputs = self._outputs | bit if line > 0 else self._outputs & ~bit

    def analog(self, output: int, volts: float) -> None:
        """See `ValArm`."""
        self._rp.write_analog(output, volts)

    def payload(self, kg: float, centre_mm: tuple[float, ...]) -> None:
        """See `ValArm`."""
        self._rp.setload(kg, centre_mm)

    def collision(self, reaction: str, thresholds: Floats | None) -> None:
        """See `ValArm`."""
        self._rp.collision(reaction, None if thresholds is None else thresholds.tolist())

    def retract(self, mm: float) -> None:
        """See `ValArm`."""
        self._rp.retract(mm)

    def sample(self) -> None:
        """See `ValArm`."""
        before = self._rp.ami.sample
        self._rp.wait(lambda: self._rp.ami.sample is not before)

    @property
    def _seen(self) -> MachineSample:
        if self._rp.ami.sample is None:
            raise LinkError(f"{self.robot.name}: nothing was heard of the robot yet")
        return self._rp.ami.sample

    def _position(self, destination: Destination) -> Pos:
        tool = new_trans_value("TOOL", destination.T_last_tool)
        if destination.q is not None:
            return Pos(destination.name, destination.q - self._zero, tool)
        if destination.T_robot_tool is None:
            raise ValueError(f"{destination.name} has neither joints nor a pose")
        goal = new_trans_value(destination.name, self._T_arcl_base @ destination.T_robot_tool)
        return makeposition(destination.name, T6, tool, EQ, goal, TL, tool)

    def _moves(self) -> bool:
        return self._rp.busy

    def _set_override(self, percent: float) -> None:
        self._rp.override(percent)

    def _look(self) -> None:
        ended = [each for each in self._going if each.motion.code is not None]
        self._going = [each for each in self._going if each.motion.code is None]
        self._stopped += [each.destination for each in ended if each.motion.code is not Event.EVENT_DONE]

    def _note(self, event: Event, _rp: ArclRobot, error: QRobotError) -> CallbackAnswer:
        """Take note of an error, as ARCL's handler of errors; the arm comes to a halt."""
        if event is not Event.EVENT_FAULT:
            self._failure = self._failure or str(error)
        return CallbackAnswer.MOVE_STOP


def _attributes(destination: Destination) -> tuple[Any, ...]:
    """The attributes of a motion, as ARCL takes them."""
    traj = MOV_TRAJ, TRAJ_CART if destination.straight else TRAJ_JOINT
    mm_s = destination.speed_mm_s
    speed = (MOV_SHARE, 100.0 * destination.share) if mm_s is None else (MOV_VT, mm_s, MOV_VR, TURN_PER_MM * mm_s)
    return *traj, *speed, *((MOV_CONFIG, destination.letters) if destination.letters else ()), 0


@contextmanager
def arcl_arm(robot: Robot, period_ms: float | None = None) -> Iterator[ArclArm]:
    """Control of an arm by ARCL, on the machine that is chosen outside (`use_machine`).

    Args:
        robot: the arm.
        period_ms: sample period, None for the machine's own.

    Raises:
        ConfigError, LinkError, ServoFault: the arm cannot be taken. MotionError: no such sample period.
    """
    rp = arcl_open(ARCL_ROBOT, robot, *(() if period_ms is None else (ARCL_PERIOD, period_ms)))
    try:
        yield ArclArm(robot, rp)
    except BaseException:
        with suppress(QRobotError):  # the first error is the one to tell
            rp.abandon()
        raise
    finally:
        arcl_errproc(None)
        forget(rp)
        rp.abandon()
