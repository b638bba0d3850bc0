"""Questions of a program to a host, and its answers: JSON of limited size, checked to the last field.

Neither end ever unpickles what it hears: functions travel as names, errors as text.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal, TypeAlias, TypeVar

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from qrobot.errors import (
    ConfigError,
    JointLimit,
    LinkBusy,
    LinkError,
    LinkLost,
    LinkTimeout,
    MotionError,
    QRobotError,
    RemoteProtocolError,
    RogueTask,
    ServoFault,
)
from qrobot.rci.common_clock import FASTEST_HZ
from qrobot.rci.descriptor import MOST_TASKS
from qrobot.rci.mail_lane import LARGEST_MESSAGE
from qrobot.realtime.bridge_token import LONGEST_BYTES
from qrobot.wire import RobotState
from qrobot.wire.robot_state import rows_of

PROTOCOL: Final = 1
MOST_MAIL: Final = 64  # messages in one packet
MOST_BYTES: Final = 1 << 19  # of a packet: that many of the largest messages fit
LONGEST_TEXT: Final = 4000
N_WORDS: Final = 6

Bit = Annotated[int, Field(ge=1, lt=1 << 31)]
Word = Annotated[int, Field(ge=-(1 << 63), lt=1 << 63)]
Text = Annotated[str, Field(max_length=LONGEST_TEXT)]
Name = Annotated[str, Field(min_length=1, max_length=200)]
Token = Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]
OrderName = Literal[
    "set_functions", "set_clock", "set_wakeup", "set_trigger", "attach", "activate", "release", "power_off"
]
Sample: TypeAlias = dict[str, int | float | list[float]]


class HostPacket(BaseModel):
    """Packet of either end; unknown fields and wrong types are errors."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        strict=True,
        ser_json_bytes="base64",
        val_json_bytes="base64",
        ser_json_inf_nan="constants",
    )


class HelloPacket(HostPacket):
    """Question of a program: who are you, and are you free?"""

    kind: Literal["hello"] = "hello"
    protocol: int = PROTOCOL


class RobotEntry(HostPacket):
    """A robot of the host's own data base, and its bridge as the host reaches it."""

    name: Name
    file: Annotated[str, Field(pattern=r"^[\w-]{1,64}$")]
    bridge: Annotated[str, Field(max_length=200)] = ""


class TaskEntry(HostPacket):
    """A task of the program, wherever it runs."""

    name: Name
    bit: Bit
    processor: Name
    priority: Word
    robot: RobotEntry | None


class BootPacket(HostPacket):
    """Run the tasks of this program that are yours; `epoch_ns` is the first tick by the host's clock.

    `token` shows to a host without certificates that the program may read its runtime folder, see `bridge_token`.
    """

    kind: Literal["boot"] = "boot"
    protocol: int = PROTOCOL
    session: Token
    token: Annotated[str, Field(max_length=LONGEST_BYTES)] = ""
    program: Name
    processor: Name
    rate_hz: Annotated[int, Field(ge=1, le=FASTEST_HZ)]
    epoch_ns: Word
    tasks: Annotated[list[TaskEntry], Field(max_length=MOST_TASKS + 1)]


class OrderPacket(HostPacket):
    """An order for the monitor: numbers and names of functions, as `Monitor` takes them."""

    kind: Literal["order"] = "order"
    session: Token
    order: OrderName
    numbers: Annotated[list[Word], Field(max_length=3)]
    functions: Annotated[list[Text], Field(max_length=3)] = []


class Mail(HostPacket):
    """A message of a task to another."""

    to: Bit
    sender: Bit
    data: Annotated[bytes, Field(min_length=1, max_length=LARGEST_MESSAGE)]


class AllowedTime(HostPacket):
    """Time that a function of a task may take, ns."""

    bit: Bit
    ns: Annotated[int, Field(ge=0, lt=1 << 63)]


class ExchangePacket(HostPacket):
    """Messages for the host's tasks; without room it shall send none. Asked again and again, it says: I am alive."""

    kind: Literal["exchange"] = "exchange"
    session: Token
    mail: Annotated[list[Mail], Field(max_length=MOST_MAIL)]
    room: bool
    allowed: Annotated[list[AllowedTime], Field(max_length=MOST_TASKS)]


class EndPacket(HostPacket):
    """The program is over."""

    kind: Literal["end"] = "end"
    session: Token


HostRequest: TypeAlias = HelloPacket | BootPacket | OrderPacket | ExchangePacket | EndPacket


class Failure(HostPacket):
    """An error, as the other end may know it."""

    kind: Name
    text: Text
    code: int = 0


class Offer(HostPacket):
    """Description of a host; `program` is the one it runs, "" for none."""

    protocol: int
    host: Name
    description: Text
    now_ns: Word
    program: Annotated[str, Field(max_length=200)]


class TaskReport(HostPacket):
    """A task of the host: state, woken, served, runs, missed and longest; how it ended; its robot as heard last."""

    bit: Bit
    starts: Annotated[int, Field(ge=0)]
    words: Annotated[list[Word], Field(min_length=N_WORDS, max_length=N_WORDS)]
    error: Failure | None = None
    how: Sample | None = None


class HostReport(HostPacket):
    """Report of a host: messages, its tasks, signals for the planning program."""

    mail: Annotated[list[Mail], Field(max_length=MOST_MAIL)]
    room: bool
    tasks: Annotated[list[TaskReport], Field(max_length=MOST_TASKS)]
    signals: Annotated[list[Annotated[int, Field(ge=1, le=64)]], Field(max_length=64)]


class HostReply(HostPacket):
    """An answer: an error, or what was asked for."""

    error: Failure | None = None
    offer: Offer | None = None
    report: HostReport | None = None


_REQUESTS: Final[TypeAdapter[HostRequest]] = TypeAdapter(Annotated[HostRequest, Field(discriminator="kind")])
_REPLIES: Final = TypeAdapter(HostReply)
T = TypeVar("T")


def encode(packet: HostPacket) -> bytes:
    """The bytes of a packet."""
    return packet.model_dump_json().encode()


def decode_request(data: bytes) -> HostRequest:
    """Read a question of a program. Raises RemoteProtocolError."""
    return _decoded(_REQUESTS, data, "the program")


def decode_reply(data: bytes, who: str) -> HostReply:
    """Read an answer of a host. Raises RemoteProtocolError."""
    return _decoded(_REPLIES, data, who)


def _decoded(adapter: TypeAdapter[T], data: bytes, who: str) -> T:
    if len(data) > MOST_BYTES:
        raise RemoteProtocolError(f"{who} sent {len(data)} bytes in one packet; {MOST_BYTES} are the most")
    try:
        return adapter.validate_json(data)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise RemoteProtocolError(f"{who} sent what is no packet of processors: {where} {first['msg']}") from None


_KINDS: Final[dict[str, type[QRobotError]]] = {
    kind.__name__: kind
    for kind in (
        ConfigError,
        JointLimit,
        LinkBusy,
        LinkError,
        LinkLost,
        LinkTimeout,
        MotionError,
        QRobotError,
        RemoteProtocolError,
        RogueTask,
    )
}


def failure_of(error: BaseException) -> Failure:
    """An error as text."""
    code = error.code if isinstance(error, ServoFault) else 0
    return Failure(kind=type(error).__name__[:200], text=str(error)[:LONGEST_TEXT], code=code)


def error_of(failure: Failure, host: str) -> QRobotError:
    """An error of our own tree; one that has no place there becomes text."""
    if failure.kind == ServoFault.__name__:
        return ServoFault(failure.code, failure.text)
    if failure.kind in _KINDS:
        return _KINDS[failure.kind](failure.text)
    return QRobotError(f"{failure.kind} on host {host}: {failure.text}")


def sample_of(how: RobotState) -> Sample:
    """A robot's state by its fields."""
    values = {row.name: getattr(how, row.name) for row in rows_of(RobotState)}
    return {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}


def how_of(sample: Sample, n: int) -> RobotState:
    """The state of a robot with `n` joints. Raises RemoteProtocolError."""
    values: dict[str, object] = {}
    for row in rows_of(RobotState):
        value, count = sample.get(row.name), n if row.count == "n" else row.count
        if count == 1:
            fits = isinstance(value, (int, float) if row.code == "d" else int)
        else:
            fits = isinstance(value, list) and len(value) == count
        if not fits:
            raise RemoteProtocolError(f"a robot's state with {row.name} {value!r}")
        values[row.name] = tuple(value) if isinstance(value, list) else value
    return RobotState(**values)  # type: ignore[arg-type]
