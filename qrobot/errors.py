"""One exception tree; a user can catch `QRobotError` and miss nothing of ours.

QRobotError
├── ConfigError            a file, option or key is wrong: names the key, the value and what is allowed
├── CodegenError           an expression cannot be made into a kernel: names the operation or argument
├── LinkError              the other side of a bus or socket
│   ├── LinkTimeout        it did not answer in time
│   ├── LinkLost           it was there and went away
│   ├── LinkMismatch       it is another robot, or runs other code, than this side expects
│   └── LinkBusy           somebody else holds it (port, board, servo, the commander's lease)
├── ProtocolError          a packet or a call breaks the wire protocol
│   ├── LocalProtocolError     our side misused the connection object
│   └── RemoteProtocolError    the far end sent something malformed or out of turn
├── MotionError            a motion cannot be done
│   ├── Unreachable        the pose is outside the workspace
│   ├── JointLimit         a joint would leave its range
│   ├── Singular           the pose is singular for this arm
│   ├── TooFast            a joint would pass its speed or acceleration: carries how much slower it can be done
│   └── FenceCrossed       the arm would come too near a fence: carries fence, body, depth and place
├── ProgramError           a VAL II program or command is wrong: names line, column and what was expected
├── ServoFault             the servo stopped the arm: carries the fault code and its last samples
├── Stalled                a process came too late, and ended a run on the wall clock
├── RogueTask              a control task of RCI took longer than it is allowed, and was ended
├── IdentificationError    recorded motion does not determine a model: names what is missing
└── LogError               a log is missing, torn or of another format
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any


class QRobotError(Exception):
    """Base of every error this project raises on purpose."""


class ConfigError(QRobotError):
    """A configuration file, option or key is wrong."""


class CodegenError(QRobotError):
    """A symbolic expression cannot be translated or compiled."""


class LinkError(QRobotError):
    """The other side of a bus or a socket failed us."""


class LinkTimeout(LinkError):
    """The far end did not answer in time."""


class LinkLost(LinkError):
    """The far end was there and went away."""


class LinkMismatch(LinkError):
    """The far end is there, and is another robot or runs other code than this side expects."""


class LinkBusy(LinkError):
    """Somebody else holds the port, the board, the servo or the commander's lease."""


class ProtocolError(QRobotError):
    """A packet or a call breaks the wire protocol."""


class LocalProtocolError(ProtocolError):
    """Our own side misused the connection."""


class RemoteProtocolError(ProtocolError):
    """The far end sent something malformed or out of turn."""


class MotionError(QRobotError):
    """A motion cannot be done as asked."""


class Unreachable(MotionError):
    """The pose lies outside the arm's workspace."""


class JointLimit(MotionError):
    """A joint would leave its range."""


class Singular(MotionError):
    """The pose is singular for this arm, so the branch is not determined."""


class TooFast(MotionError):
    """A joint would pass its speed or its acceleration.

    Attributes:
        reason: which joint, and by how much.
        remedy: in the words of RCCL.
        share: of the speed asked for at which the motion can be done, 0 to 1; 0 where that is not known.
    """

    def __init__(self, reason: str, remedy: str, share: float = 0.0) -> None:
        super().__init__(f"{reason}; {remedy}")
        self.reason, self.remedy, self.share = reason, remedy, share

    def __reduce__(self) -> tuple[type[TooFast], tuple[str, str, float]]:
        return TooFast, (self.reason, self.remedy, self.share)


class FenceCrossed(MotionError):
    """The arm would come too near a fence.

    Attributes:
        fence: its name; `itself` for the arm's own body.
        body: part of the arm that is nearest to it.
        depth_m: how far inside the margin of the fence.
        share: of the way where that is, 0 to 1.
    """

    def __init__(self, message: str, fence: str = "", body: str = "", depth_m: float = 0.0, share: float = 0.0) -> None:
        super().__init__(message)
        self.fence, self.body, self.depth_m, self.share = fence, body, depth_m, share

    def __reduce__(self) -> tuple[type[FenceCrossed], tuple[str, str, str, float, float]]:
        return FenceCrossed, (str(self), self.fence, self.body, self.depth_m, self.share)


class ProgramError(QRobotError):
    """A program or a command in VAL II cannot be read or done.

    Attributes:
        what: what is wrong, and what was expected.
        line: of the file, from 1; 0 for none.
        column: of the line, from 1; 0 for none.

    `file` is named before them in the message.
    """

    def __init__(self, what: str, line: int = 0, column: int = 0, file: str = "") -> None:
        places = [f"{name} {number}" for name, number in (("line", line), ("column", column)) if number]
        where = ", ".join([file, *places] if file else places)
        super().__init__(f"{where}: {what}" if where else what)
        self.what, self.line, self.column = what, line, column


class RogueTask(QRobotError):
    """A control task of RCI took longer than it is allowed."""


class IdentificationError(QRobotError):
    """Recorded data do not determine the parameters of a model, or contradict it."""


class LogError(QRobotError):
    """A log is missing, torn or of a format this version does not read."""


class ServoFault(QRobotError):
    """The servo stopped the arm.

    Attributes:
        code: value of `qrobot.faultcodes.FaultCode`.
        trace: the last samples before the stop, newest last; may be empty when only the code is known.
    """

    def __init__(self, code: int, message: str, trace: Any = ()) -> None:
        super().__init__(message)
        self.code = code
        self.trace = trace

    def __reduce__(self) -> tuple[type[ServoFault], tuple[int, str, Any]]:
        return ServoFault, (self.code, str(self), self.trace)


class Stalled(QRobotError):
    """A run on the wall clock was stopped by a process that came too late, and not by the arm."""


def error_text(error: Exception) -> str:
    """Text of an error; of an OSError without its number, and the name of the file, which the caller tells."""
    return str(getattr(error, "strerror", None) or error)


@contextmanager
def letting_go(let_go: Callable[[], object]) -> Iterator[None]:
    """Call `let_go` after the block, however that ends; of two errors of ours the first one is told, the block's."""
    try:
        yield
    except BaseException:
        with suppress(QRobotError):
            let_go()
        raise
    let_go()


def raise_first(errors: Sequence[BaseException], ours_too: bool) -> None:
    """Raise the first of several errors, if there are any: what is no error of ours before them, as Ctrl-C.

    Args:
        errors: in their order.
        ours_too: raise errors of ours as well.
    """
    others = [error for error in errors if not isinstance(error, QRobotError)]
    for error in (*others, *(errors if ours_too else ())):
        raise error
