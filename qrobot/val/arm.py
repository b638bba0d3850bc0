"""The interpreter's interface to an arm, as narrow as it can be: any library that moves one can be put below it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol

from qrobot.arrays import Floats
from qrobot.config import Robot

SETTLING_S: Final = 0.15  # the servo has then come after its last setpoints [A]


@dataclass(frozen=True, eq=False)
class Destination:
    """The goal of a motion, and the manner of it.

    Attributes:
        name: for messages.
        T_robot_tool: pose of the tool in the robot's base frame, m, shape (4, 4); None when `q` is given.
        T_last_tool: pose of the tool in the last link's frame, m, shape (4, 4).
        q: joint positions, rad or m, shape (n,); None when the pose is given.
        straight: the tool goes in a straight line.
        share: of the joints' own speed limits.
        speed_mm_s: of the tool, instead of `share`; None for none.
        letters: configuration at its end, as in "lun"; empty to keep the present one.
    """

    name: str
    T_robot_tool: Floats | None
    T_last_tool: Floats
    q: Floats | None
    straight: bool
    share: float
    speed_mm_s: float | None
    letters: str


class ValArm(Protocol):
    """An arm under control. Motions are queued; nothing waits but `sample`.

    Attributes:
        robot: the arm.
        override: per cent of their speed at which motions go, those under way too; above 0, up to 100.
    """

    robot: Robot
    override: float

    @property
    def time_s(self) -> float:
        """The robot's own time."""

    @property
    def q(self) -> Floats:
        """Measured joint positions, rad or m. Shape (n,)."""

    @property
    def setpoint(self) -> Floats:
        """Joint positions that the arm was told last, rad or m, from which its next motion begins. Shape (n,)."""

    @property
    def inputs(self) -> int:
        """Binary inputs, input 1001 in bit 0."""

    @property
    def outputs(self) -> int:
        """Binary outputs in force, output 1 in bit 0."""

    @property
    def kept(self) -> str:
        """Reason for which the arm has been stopped; its path is kept until `resume`. Empty for none."""

    @property
    def off_path(self) -> bool:
        """The arm is off its path: it waits (`kept`), is led back to it, or goes back from what it met (`retract`)."""

    @property
    def waiting(self) -> int:
        """Motions that have not begun."""

    @property
    def idle(self) -> bool:
        """Everything is done, and the arm stands on its path."""

    def move(self, destination: Destination) -> None:
        """Queue a motion, joined to the one before without a stop. Raises MotionError when it cannot be done."""

    def unfinished(self) -> list[Destination]:
        """Motions that have not ended, or were stopped before their end, oldest first; each is told once."""

    def failure(self) -> str:
        """Tell why a motion failed that had begun, in words, once; empty when none did."""

    def stop(self) -> None:
        """Come to rest on the path, and forget what waits. Control of an arm that is off its path is lost."""

    def pause(self) -> None:
        """Let an arm that is off its path stand still on its way; `kept` tells so, until `resume`."""

    def resume(self) -> None:
        """Let an arm that has been stopped, and whose path is `kept`, go back to it, and on."""

    def hand(self, opened: bool) -> None:
        """Open or close it, now."""

    def signal(self, *lines: int) -> None:
        """Switch outputs, now; negative ones off."""

    def analog(self, output: int, volts: float) -> None:
        """Let an analogue output, from 1, show `volts`. Raises MotionError: there is none, or it does not show that."""

    def payload(self, kg: float, centre_mm: tuple[float, ...]) -> None:
        """Tell the arm what it carries, and where in the flange's frame; half a second passes.

        Raises MotionError: it cannot, and nothing has changed.
        """

    def collision(self, reaction: str, thresholds: Floats | None) -> None:
        """Choose what follows a collision, "stop" or "comply", and when one is told; some samples pass.

        Thresholds are torques, N m (N), shape (n,), None for those of the robot file. Raises MotionError: no such.
        """

    def retract(self, mm: float) -> None:
        """Let the arm go back after a collision, by `mm` of its flange; then its path is `kept`. 0: it stays there.

        Raises MotionError: no such distance.
        """

    def sample(self) -> None:
        """Let one sample pass. Raises QRobotError when the arm is lost."""
