"""The servo of one arm as other processes see it, followed through restarts."""

from __future__ import annotations

from qrobot.errors import LinkError, LinkMismatch
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.servo_memory import ServoSegment, attach_servo_memory


class FollowedServo:
    """Mailbox of the servo of one arm, which may die, restart or not be there yet.

    Args:
        arm: instance name.
        robot, n: what it has to drive, and how many joints that has.

    Attributes:
        count: how many servos there have been; a new file may begin its generations anew.
        mismatch: why a servo that runs is not the one meant, as was last seen; "" for none.
    """

    def __init__(self, arm: str, robot: str, n: int) -> None:
        self._arm, self._drives = arm, (robot, n)
        self._segment: ServoSegment | None = None
        self._mailbox: ServoMailbox | None = None
        self._generation = self.count = 0
        self.mismatch = ""

    def mailbox(self) -> ServoMailbox:
        """The servo's that runs now. Raises LinkError: there is none; of it LinkMismatch: it drives another robot."""
        try:
            mailbox = self._find()
        except LinkError as error:
            self.mismatch = str(error) if isinstance(error, LinkMismatch) else ""
            raise
        self.mismatch = ""
        return mailbox

    def _find(self) -> ServoMailbox:
        segment = self._segment
        if segment is None or not segment.is_current:
            self.close()
            segment = self._segment = attach_servo_memory(self._arm)
        generation = int(segment.header.generation)
        if self._mailbox is None or generation != self._generation:
            self._mailbox, self._generation = None, generation
            mailbox = ServoMailbox(segment.words)
            info = mailbox.info
            if (info.robot_name, info.n) != self._drives:
                robot, n = self._drives
                same = info.robot_name == robot
                wrong = f"{info.n} joints, not {n}" if same else f"{info.robot_name!r}, not {robot!r}"
                raise LinkMismatch(f"the servo of {self._arm} drives {wrong}")
            self._mailbox, self.count = mailbox, self.count + 1
        return self._mailbox

    def close(self) -> None:
        """Let the memory go."""
        if self._segment is not None:
            self._segment.close()
        self._segment = self._mailbox = None
