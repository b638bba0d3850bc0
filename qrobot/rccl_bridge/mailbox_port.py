"""The way to a servo in this process."""

from __future__ import annotations

from qrobot.arrays import Words
from qrobot.model.payload_judge import PayloadJudge
from qrobot.rccl_bridge.request_port import RequestPort
from qrobot.rccl_bridge.servo_interface import SetpointFrame
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.servo_memory import local_servo_memory
from qrobot.servo.memory.telemetry import SMALLEST_RING
from qrobot.units import NS_PER_S


def warm_up() -> None:
    """Compile, or load from the cache, what a port calls: it would take longer than a sample period."""
    port = MailboxPort(local_servo_memory("warm-up", "", 1, NS_PER_S, SMALLEST_RING))
    port.read_state()
    port.write_setpoint(SetpointFrame(0, 0, 0, 0, (0,), (0.0,), False, False, False, 0, 0))


class MailboxPort(RequestPort):
    """`RobotPort` over servo memory in this process: lock-step and tests, where the servo is always there.

    Args:
        words: the memory. judge: of payloads; None takes each.
    """

    mismatch = ""
    servo = 1

    def __init__(self, words: Words, judge: PayloadJudge | None = None) -> None:
        super().__init__(judge)
        self._own = ServoMailbox(words)

    def _mailbox(self) -> ServoMailbox:
        return self._own

    @property
    def robot_name(self) -> str:
        """Name of the robot, as clients have to give it."""
        return self._own.info.robot_name

    @property
    def arm(self) -> str:
        """An arm inside of this process has no other name."""
        return self.robot_name

    @property
    def n(self) -> int:
        """Number of joints."""
        return self._own.info.n

    def alive(self) -> bool:
        """The servo is part of this process."""
        return True

    def slipped_ns(self) -> int:
        """Virtual time never slips."""
        return 0

    def stalled(self) -> bool:
        """Nor does it stand still."""
        return False
