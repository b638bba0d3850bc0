"""The way to a servo process: its shared memory, followed through restarts."""

from __future__ import annotations

import contextlib
import time
from dataclasses import replace
from typing import Final

from qrobot.errors import LinkError
from qrobot.model.payload_judge import PayloadJudge
from qrobot.rccl_bridge.arm_time import read_arm_time_ns
from qrobot.rccl_bridge.request_port import RequestPort
from qrobot.rccl_bridge.servo_interface import SetpointFrame
from qrobot.servo.memory.followed_servo import FollowedServo
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.servo_memory import ServoMemory
from qrobot.units import NS_PER_US
from qrobot.wire.vocabulary import LONGEST_PERIOD_US

STALLED_NS: Final = 20_000_000  # a servo whose last cycle is older waits for its emulated board, or was stopped [A]
NEW_SERVO_NS: Final = LONGEST_PERIOD_US * NS_PER_US  # a new servo counts as away so long: each session sees it
STALE_NS: Final = 250_000_000  # a servo whose last cycle is older does not run, whatever its guardian says


def shows_life(memory: ServoMemory, silence_ns: int) -> bool:
    """Whether a servo runs whose last cycle was so long ago.

    One that its guardian has taken the board from, for silence, has to show sooner that it runs again: after two
    periods, where its cycles are that long.
    """
    soon_ns = min(max(STALLED_NS, 2 * int(memory.info.period_ns)), STALE_NS)
    return abs(silence_ns) < (soon_ns if memory.guardian.takeover else STALE_NS)


class ServoPort(RequestPort):
    """`RobotPort` to the servo process of one arm, which may die, restart or not be there yet.

    Args:
        arm: instance name.
        robot_name, n: what the deployment says of it; a servo of another robot counts as gone.
        judge: of payloads; None takes each.
    """

    def __init__(self, arm: str, robot_name: str, n: int, judge: PayloadJudge | None = None) -> None:
        super().__init__(judge)
        self.arm = arm
        self.robot_name = robot_name
        self.n = n
        self._followed = FollowedServo(arm, robot_name, n)
        self._slipped_ns = self._new_until_ns = 0
        self._power_locked = False  # a servo that has just started is not powered by a request made to the one before

    @property
    def servo(self) -> int:
        """Number of the servo that is followed: how many there have been."""
        return self._followed.count

    @property
    def mismatch(self) -> str:
        """Reason for which the servo that runs cannot be used; "" for one that can, or that is not there."""
        return self._followed.mismatch

    def alive(self) -> bool:
        """The servo runs and its state is fresh."""
        try:
            memory = self._mailbox().memory
        except LinkError:
            return False
        noticed = time.monotonic_ns() >= self._new_until_ns  # also by a bridge that stood still while it was away
        return noticed and bool(memory.info.ready) and shows_life(memory, self._silence_ns(memory))

    def slipped_ns(self) -> int:
        """Delay of the arm's time behind CLOCK_MONOTONIC, as a servo said last in a cycle; 0 before one did."""
        with contextlib.suppress(LinkError):
            heartbeat = self._mailbox().memory.heartbeat
            if heartbeat.t_ns != 0:  # one that has just started has said nothing yet; read first, as it is written last
                said = int(heartbeat.slipped_ns)
                self._slipped_ns = said if 0 <= said < time.monotonic_ns() else 0
        return self._slipped_ns

    def stalled(self) -> bool:
        """An emulated arm's servo has not run of late: `slipped_ns` may be about to change."""
        try:
            memory = self._mailbox().memory
        except LinkError:
            return False
        return bool(memory.heartbeat.slips) and self._silence_ns(memory) > STALLED_NS

    def _silence_ns(self, memory: ServoMemory) -> int:
        heard_ns = int(memory.heartbeat.t_ns)  # first: what is read later can only make the silence longer
        return read_arm_time_ns(self.slipped_ns) - heard_ns

    def write_setpoint(self, frame: SetpointFrame) -> None:
        """Hand a frame and its requests to the servo. Raises LinkError when the servo is gone."""
        super().write_setpoint(self._allowed(frame))

    def write_requests(self, frame: SetpointFrame) -> None:
        """Hand over what a frame requests, without its setpoints. Raises LinkError when the servo is gone."""
        super().write_requests(self._allowed(frame))

    def _allowed(self, frame: SetpointFrame) -> SetpointFrame:
        """The frame, without a request for power that was made to the servo before this one.

        Such a request is none to take power away either, from an arm that somebody else has powered since.
        """
        command = self._mailbox().memory.command  # first: only now is it known whether that is another servo
        if not frame.power:
            self._power_locked = False
        return replace(frame, power=bool(command.power)) if self._power_locked else frame

    def _mailbox(self) -> ServoMailbox:
        before = self._followed.count
        mailbox = self._followed.mailbox()
        if 0 < before < self._followed.count:
            self._power_locked, self._new_until_ns = True, time.monotonic_ns() + NEW_SERVO_NS
        return mailbox
