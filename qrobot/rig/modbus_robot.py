"""A running robot behind a Modbus map: what its servo and its board show, for reading only."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic

from qrobot.arrays import Words
from qrobot.errors import LinkBusy, LinkLost
from qrobot.hwif.board_memory import attach_board_memory
from qrobot.hwif.bus import BoardFacts, MemoryEndpoint, Operations
from qrobot.hwif.modbus.map import encode_robot
from qrobot.realtime.shared_memory import SegmentT
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.servo_memory import attach_servo_memory


class Follower(Generic[SegmentT]):
    """Shared memory of somebody who may be started again.

    Args:
        attach: maps it; raises LinkError when nobody serves it.
        who: for messages.
    """

    def __init__(self, attach: Callable[[], SegmentT], who: str) -> None:
        self._attach, self._who = attach, who
        self._segment: SegmentT | None = None

    def newest(self) -> SegmentT:
        """The segment of whoever serves it now. Raises LinkError when nobody does."""
        if self._segment is not None and not self._segment.is_current:
            self.close()
        if self._segment is None:
            self._segment = self._attach()
        if not self._segment.owner_alive:
            self.close()
            raise LinkLost(f"{self._who} has ended")
        return self._segment

    def close(self) -> None:
        """Unmap it."""
        if self._segment is not None:
            self._segment.close()
            self._segment = None


class RunningRobot:
    """The far end of a transport that leads to a robot whose servo has the board.

    Args:
        arm: instance name.
    """

    def __init__(self, arm: str) -> None:
        self._arm = arm
        self._board = Follower(lambda: attach_board_memory(arm), f"the board of {arm}")
        self._servo = Follower(lambda: attach_servo_memory(arm), f"the servo of {arm}")

    def facts(self) -> BoardFacts:
        """The board's. Raises LinkError when there is none."""
        return MemoryEndpoint(self._board.newest().memory).facts()

    def read_image(self, image: Words) -> None:
        """The image the servo sees. Raises LinkError when there is none."""
        MemoryEndpoint(self._board.newest().memory).read_image(image)

    def apply(self, operations: Operations) -> None:
        """Raises LinkBusy: the servo has the board."""
        raise LinkBusy(f"the servo of {self._arm} has the board: {len(operations)} operations refused")

    def registers(self) -> list[int]:
        """The servo's state as registers of the map. Raises LinkError when there is no servo."""
        mailbox = ServoMailbox(self._servo.newest().words)
        seen = mailbox.snapshot()
        words = (
            seen.mode,
            seen.fault,
            seen.event,
            seen.event_joint,
            seen.flags,
            seen.inputs,
            seen.hand,
            mailbox.info.n,
        )
        return encode_robot(words, seen.t_ns, seen.tick, seen.outputs, (seen.q, seen.v, seen.tau, seen.q_setpoint))

    def close(self) -> None:
        """Let go of both."""
        self._board.close()
        self._servo.close()
