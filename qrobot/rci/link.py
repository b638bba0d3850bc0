"""Interface of a way to the robot."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final, Protocol, TypeAlias

from qrobot.config import Robot
from qrobot.errors import LinkError, MotionError
from qrobot.rci.client import Beside, ServoLoss
from qrobot.units import US_PER_MS
from qrobot.wire import ClientRole, Command, Hello, State, Welcome
from qrobot.wire.vocabulary import LONGEST_PERIOD_US, SHORTEST_PERIOD_US

PROGRAM_NAME_LENGTH = 32
NEW_PERIOD: Final = "another sample period"  # why a program says goodbye that greets again at once


class Link(Protocol):
    """One conversation with a bridge, as its commander.

    Attributes:
        virtual_time: time passes only while somebody waits in `exchange`; otherwise it passes by itself, and the server
            wants an answer in every sample period.
    """

    virtual_time: bool

    def open(self) -> Welcome:
        """Greet the server.

        Raises:
            LinkTimeout: nobody answers.
            LinkLost: nobody is there, or the connection broke.
            LinkBusy: somebody else commands the robot.
            LinkError: the server refused for another reason, which the text gives.
            RemoteProtocolError: the far end does not speak the protocol.
        """

    def exchange(self, command: Command | None) -> State:
        """Send a command, or nothing, and wait for the newest STATE after it. Raises what `open` raises."""

    def tell(self, packet: Beside) -> None:
        """Send a packet with the next `exchange`. May be called from any thread."""

    def refusal(self, kind: type[Beside]) -> str:
        """Reason why what was told last of that kind was refused, "" when it was not, or no answer has come yet."""

    def take_servo_loss(self) -> ServoLoss:
        """Whether the servo was away before the STATE that `exchange` has given last; told once."""

    def now_ns(self) -> int:
        """This end's clock."""

    def reopen(self, period_us: int) -> Welcome:
        """Say goodbye, and greet the server anew to have another sample period. Raises what `open` raises."""

    def close(self, reason: str = "") -> None:
        """Say goodbye. Never raises; may be called twice."""


LinkFactory: TypeAlias = Callable[[Hello], Link]
"""Chooses the way to the robot that the greeting names; given by whoever starts the program."""


def hello_for(robot_name: str, period_us: int = 0) -> Hello:
    """Greeting of a program as commander of `robot_name`; a period of 0 takes the server's."""
    program = Path(sys.argv[0] or "python").name[:PROGRAM_NAME_LENGTH]
    return Hello(ClientRole.COMMANDER, robot_name, program, period_us)


def sample_period_us(call: str, ms: float) -> int:
    """A sample period, microseconds. Raises MotionError when bridges have no such period."""
    period_us = round(ms * US_PER_MS)
    if not SHORTEST_PERIOD_US <= period_us <= LONGEST_PERIOD_US:
        possible = f"{SHORTEST_PERIOD_US / US_PER_MS:g} to {LONGEST_PERIOD_US / US_PER_MS:g} ms"
        raise MotionError(f"{call}: a sample period of {ms:g} ms; {possible} are possible")
    return period_us


def check_welcome(welcome: Welcome, robot: Robot, who: str) -> None:
    """Raise LinkError when the bridge drives another robot than `who` wants."""
    if (welcome.robot, welcome.n) != (robot.name, robot.n):
        here = f"{welcome.robot!r} with {welcome.n} joints"
        raise LinkError(f"the bridge drives {here}, {who} wants {robot.name!r} with {robot.n}")
