"""An arm moved by words, in small steps: what the interpreters that teach have in common.

Made of the library's own calls, as in Hayward & Paul 1986, section 4.2: where the arm is, is measured by `update`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeAlias

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import LinkError, MotionError, QRobotError, ServoFault
from qrobot.model.orientation import rpy_angles
from qrobot.motion import Termination
from qrobot.rccl.arguments import small_move
from qrobot.rccl.channel import Channel
from qrobot.rccl.position import EQ, TL, Position, makeposition
from qrobot.rccl.trace import reason_of
from qrobot.rccl.transforms import Transform, const, made_transform, newtrans, t6
from qrobot.units import DEG_PER_RAD, MM_PER_M

SETTLING_MS: Final = 150.0  # the last setpoints are still under way when a motion is completed
STEPPING_HELP: Final = """\
world dx 10 rz 5   move by mm (dx dy dz) and degrees (rx ry rz) along the axes of the base
tool dz -10        the same along the axes of the last link
joint 3 -5         turn one joint by degrees (mm on a sliding one)
joints 0 -45 ...   go to these joint positions, one for each joint; joints alone tells them
where              where the arm is
park               go to the park pose
open, close        the hand"""

JogCommand: TypeAlias = Callable[[list[str]], str]


class Stepper:
    """Obeys commands.

    Args:
        arm: under control, at rest.

    Attributes:
        over: nothing more is to be obeyed.
    """

    def __init__(self, arm: Channel) -> None:
        self.over = False
        self._arm = arm
        self._commands: dict[str, JogCommand] = {
            "world": lambda words: self._step(words, in_world=True),
            "tool": lambda words: self._step(words, in_world=False),
            "joint": self._turn,
            "joints": self._go_to_joints,
            "where": lambda _: place(self._measure("HERE").value),
            "park": lambda _: self._go(self._arm.pose("park")),
            "open": lambda _: self._hand(self._arm.OPEN),
            "close": lambda _: self._hand(self._arm.CLOSE),
        }

    def obey(self, line: str) -> str:
        """Do what a line says; what is to be answered. What stands behind a # is a comment.

        Mistakes and motions that cannot be done are answered, they end nothing.

        Raises:
            LinkError, ServoFault: the arm is lost.
        """
        try:
            return self.carry_out(line)
        except (LinkError, ServoFault):
            raise
        except QRobotError as error:
            return f"error: {error}"

    def carry_out(self, line: str) -> str:
        """`obey` of a line whose answer nobody reads. Raises QRobotError too for what cannot be done."""
        words = line.partition("#")[0].split()
        if not words:
            return ""
        command = self._commands.get(words[0])
        if command is None:
            raise MotionError(f"unknown command {words[0]!r}; try help")
        return command(words[1:])

    def _step(self, words: list[str], in_world: bool, axes: Floats | None = None) -> str:
        step = _small_move(words) if axes is None else along_axes(_small_move(words), axes)
        return self._go(fixed_position("GOAL", moved_by(measure(self._arm, "HERE").value, step, in_world)))

    def _turn(self, words: list[str]) -> str:
        joints = asked_joints(self._arm)
        try:
            number, step = words
            joint, by = int(number) - 1, float(step)
        except ValueError:
            raise MotionError("say a joint and how far, as in: joint 3 -5") from None
        if not 0 <= joint < joints.size:
            raise MotionError(f"there are joints 1 to {joints.size}")
        joints[joint] += by
        return self._go(self._arm.jposition(f"joint {number}", joints.tolist()))

    def _go_to_joints(self, words: list[str]) -> str:
        """The test entry of the QRobot paper: joint setpoints typed in degrees."""
        if words:
            try:
                goal = [float(word) for word in words]
            except ValueError:
                raise MotionError("say a number for each joint, degrees or mm, as `joints` alone tells them") from None
            self._go(self._arm.jposition("joints", goal))
        return "joints " + " ".join(f"{round(joint, 2) + 0.0:.2f}" for joint in self._arm.joints)

    def _measure(self, name: str) -> Transform:
        return measure(self._arm, name)

    def _record_into(self, trsf: Transform, position: Position) -> None:
        record_into(self._arm, trsf, position)

    def _go(self, position: Position) -> str:
        self._arm.move(position)
        self._arm.waitfor(self._arm.completed)
        settled = self._arm.time + SETTLING_MS
        self._arm.waitas(lambda: self._arm.time >= settled)
        if position.code != Termination.COMPLETED:
            raise MotionError(f"the motion to {position.name} ended early: {reason_of(position.code)}")
        return place(self._measure("HERE").value)

    def _hand(self, act: Callable[[], None]) -> str:
        act()
        return "done"

    def _quit(self) -> str:
        self.over = True
        return ""


def asked_joints(arm: Channel) -> Floats:
    """Setpoints of the joints, degrees (mm on a sliding joint), not where they sag to. Shape (n,)."""
    setpoints: Floats = np.array(arm.how.q_setpoint) * np.where(arm.robot.prismatic, MM_PER_M, DEG_PER_RAD)
    return setpoints


def measure(arm: Channel, name: str) -> Transform:
    """Measure where an arm at rest is, by `update`."""
    here = newtrans(name)
    record_into(arm, here, position_of(here))
    return here


def record_into(arm: Channel, trsf: Transform, position: Position) -> None:
    """Give `trsf` the value that makes the equation of `position` true where the arm is."""
    arm.update(trsf, position)
    arm.move(arm.there)
    arm.waitfor(arm.completed)


def moved_by(value: Floats, step: Floats, in_base: bool) -> Floats:
    """A frame (4, 4) moved by a step (4, 4), about its own origin along the axes of the base, or along its own."""
    if not in_base:
        return value @ step
    moved = value.copy()
    moved[:3, :3] = step[:3, :3] @ value[:3, :3]
    moved[:3, 3] += step[:3, 3]
    return moved


def along_axes(step: Floats, axes: Floats) -> Floats:
    """A step (4, 4) along the axes of the base, of one told along the columns of `axes` (3, 3) in the base."""
    turned = step.copy()
    turned[:3, :3], turned[:3, 3] = axes @ step[:3, :3] @ axes.T, axes @ step[:3, 3]
    return turned


def position_of(trsf: Transform) -> Position:
    """T6 = `trsf`."""
    return makeposition(trsf.name, t6, EQ, trsf, TL, trsf)


def fixed_position(name: str, value: Floats) -> Position:
    """T6 = a frame (4, 4) that stays what it is: one that may change is followed, at full speed in any case."""
    return position_of(made_transform(name, const, value))


def place(value: Floats) -> str:
    """Position and orientation of a frame (4, 4) for people: the numbers of a data base, and of `gentr_rpy`."""
    x, y, z = value[:3, 3] * MM_PER_M
    roll, pitch, yaw = (_without_sign_of_zero(angle * DEG_PER_RAD) for angle in rpy_angles(value[:3, :3]))
    return f"at {x:.1f} {y:.1f} {z:.1f} mm, roll {roll:.1f} pitch {pitch:.1f} yaw {yaw:.1f} deg"


def _without_sign_of_zero(value: float) -> float:
    return round(value, 1) + 0.0


def _small_move(words: list[str]) -> Floats:
    """The transform of "dx 10 rz 5"."""
    try:
        values = [float(word) for word in words[1::2]]
    except ValueError:
        values = []
    if not words or len(words) != 2 * len(values) or not np.isfinite(values).all():
        raise MotionError("say directions and how far, as in: dx 10 rz 5 (mm and degrees)")
    return small_move(" ".join(words[::2]), tuple(values))
