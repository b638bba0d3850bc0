"""Messages of the control interface: one JSON object a line, a request from the client, a reply from the servo.

    {"command": "law", "name": "pd"}
    {"ok": true}                                    or, refused, {"ok": false, "error": "..."}

A request that is not exactly one of those below is refused and changes nothing.
"""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from qrobot.errors import ConfigError, RemoteProtocolError
from qrobot.wire.vocabulary import LARGEST_OVERRIDE

VERSION: Final = 1
MAX_LINE_BYTES: Final = 8192  # a longer line is no request; 32 joints' gains take a third of it


class OperatorMessage(BaseModel):
    """A closed, frozen JSON object."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class StatusRequest(OperatorMessage):
    """Tell how the servo is. Anybody may ask."""

    command: Literal["status"] = "status"


class FencesRequest(OperatorMessage):
    """Tell which fences are in force, and how far off they are. Anybody may ask."""

    command: Literal["fences"] = "fences"


class StopRequest(OperatorMessage):
    """Stop on the path and hold. Anybody may."""

    command: Literal["stop"] = "stop"


class PowerOff(OperatorMessage):
    """Stop, then take arm power away; it stays away until it is asked for anew. Anybody may."""

    command: Literal["power off"] = "power off"


class PowerOn(OperatorMessage):
    """Ask for arm power."""

    command: Literal["power on"] = "power on"


class Clear(OperatorMessage):
    """Leave FAULT for OFF, if its cause is gone. Nothing moves."""

    command: Literal["clear"] = "clear"


class Calibrate(OperatorMessage):
    """Calibrate a powered arm over so many index pulses a joint; 0 leaves the number to the servo."""

    command: Literal["calibrate"] = "calibrate"
    indexes: int = Field(default=0, ge=0, le=14)


class ChangeLaw(OperatorMessage):
    """Swap the control law, holding or without power. Of its `settings` those left out have their default.

    A compliant law that is in force already gets other settings, in any mode; those left out stay.
    """

    command: Literal["law"] = "law"
    name: str = Field(min_length=1, max_length=512)
    settings: dict[str, Annotated[float, Field(allow_inf_nan=False)]] = Field(default={}, max_length=32)


class ZeroForce(OperatorMessage):
    """Count what the force sensor shows now as no load, at rest."""

    command: Literal["tare"] = "tare"


class ChangeOverride(OperatorMessage):
    """Let motions go at so many times their programmed speed, 1 for that speed."""

    command: Literal["override"] = "override"
    factor: float = Field(ge=0, le=LARGEST_OVERRIDE, allow_inf_nan=False)


class PauseRequest(OperatorMessage):
    """Let motions stand still on their path."""

    command: Literal["pause"] = "pause"


class ResumeRequest(OperatorMessage):
    """Let motions that were paused go on."""

    command: Literal["resume"] = "resume"


Number = Annotated[float, Field(allow_inf_nan=False)]


class ChangePayload(OperatorMessage):
    """Reckon with another payload; see `wire.packets.Payload`."""

    command: Literal["payload"] = "payload"
    mass: float = Field(ge=0, allow_inf_nan=False)
    centre: Annotated[tuple[Number, Number, Number], Field(strict=False)] = (0.0, 0.0, 0.0)
    inertia: Annotated[tuple[Number, Number, Number, Number, Number, Number], Field(strict=False)] = (0.0,) * 6


class ChangeCollision(OperatorMessage):
    """Tell collisions sooner, and choose what follows them.

    `thresholds` in N m (N), one a joint, at most the robot file's `unexplained_torque`; none at all for that.
    """

    command: Literal["collision"] = "collision"
    thresholds: Annotated[
        tuple[Annotated[float, Field(gt=0, allow_inf_nan=False)], ...], Field(max_length=32, strict=False)
    ] = ()
    reaction: Literal["stop", "comply"] = "stop"


Gains = Annotated[tuple[Annotated[float, Field(ge=0, allow_inf_nan=False)], ...], Field(max_length=32, strict=False)]


class ChangeGains(OperatorMessage):
    """Change gains, holding or without power; a row that is left out stays as it is.

    `kp` in N m/rad, `kv` in N m s/rad, `inertia` in kg m^2 (N/m, N s/m and kg for sliding joints), one number a joint.
    More than four times the robot file's has to be forced, and less than a quarter of its `kv`.
    """

    command: Literal["gains"] = "gains"
    kp: Gains | None = None
    kv: Gains | None = None
    inertia: Gains | None = None
    force: bool = False


OperatorRequest = Annotated[
    StatusRequest
    | FencesRequest
    | StopRequest
    | PowerOff
    | PowerOn
    | Clear
    | Calibrate
    | ChangeLaw
    | ChangeGains
    | ZeroForce
    | ChangeOverride
    | ChangeCollision
    | ChangePayload
    | PauseRequest
    | ResumeRequest,
    Field(discriminator="command"),
]

RequestT = TypeVar("RequestT", bound=OperatorMessage)

_REQUEST: Final[TypeAdapter[OperatorRequest]] = TypeAdapter(OperatorRequest)


class BoardStatus(OperatorMessage):
    """The board memory as the servo finds it; all counters since the board's side started.

    Attributes:
        age_ms: of the newest image; None while there is none.
        losses: times a gateway lost the board behind it.
        dropped: operations that may never have acted: posted while the board was away, or in a damaged lane.
        illegal: operations without meaning, which the board ignored.
        module_losses: times a remote module, or a sensor's interface, beside the board was lost.
        slipped_ms: how long an emulated arm's time stood still because nobody could run.
    """

    age_ms: float | None = None
    losses: int
    dropped: int
    illegal: int
    module_losses: int
    slipped_ms: float = 0.0


class ServoStatus(OperatorMessage):
    """Status of a servo. Vectors have one number a joint, SI units.

    Attributes:
        event: newest code worth knowing, 0 for none; `text` explains it, or the fault, to people.
        event_joint: joint it speaks of, from 0; -1 (`faultcodes.NO_JOINT`) for none.
        hand: relaxed, open or closed, as it was last asked for.
        inputs: numbers of the discrete inputs that are on; the emergency stop's is no input here.
        outputs: the lines of the deployment by name, true for on.
        analog_outputs: volts of its analogue outputs by name.
        board: what became of the way to the board.
        override, paused: what the operator wants of motions: a factor of their speed, to stand still on their path.
        path_waits: a program waits for somebody to confirm that the arm may go back to its path.
        speed_limit, tool_speed_limit: within which programs plan; see `wire.robot_state`.
        payload_mass: kg, of the payload that the servo reckons with.
        collision_thresholds: torque nobody commanded at which a collision is told, N m (N); more under a compliant law.
        collision_reaction: what follows one, stop or comply.
        page_faults: how often the loop had to wait for memory since it began.
        commander: who commands, "" for nobody.
        force: on the wrist's sensor, fx fy fz tx ty tz, N and N m; None where it is not known.
    """

    version: int = VERSION
    arm: str
    robot: str
    rate_hz: float
    law: str
    law_settings: dict[str, float]
    mode: str
    fault: int
    event: int
    event_joint: int
    text: str
    powered: bool
    calibrated: bool
    estop_ok: bool
    guarded: bool
    commander: str
    force: tuple[float | None, ...] = Field(default=(), strict=False)
    tick: int
    late_cycles: int
    page_faults: int
    missed_frames: int
    hand: str
    inputs: Annotated[tuple[int, ...], Field(strict=False)]
    outputs: dict[str, bool]
    override: float = 1.0
    paused: bool = False
    path_waits: bool = False
    analog_outputs: dict[str, float] = {}
    speed_limit: float = 1.0
    tool_speed_limit: float = 0.0
    payload_mass: float = 0.0
    collision_thresholds: Annotated[tuple[float, ...], Field(strict=False)] = ()
    collision_reaction: str = "stop"
    q: Annotated[tuple[float, ...], Field(strict=False)]
    v: Annotated[tuple[float, ...], Field(strict=False)]
    tau: Annotated[tuple[float, ...], Field(strict=False)]
    kp: Annotated[tuple[float, ...], Field(strict=False)]
    kv: Annotated[tuple[float, ...], Field(strict=False)]
    inertia: Annotated[tuple[float, ...], Field(strict=False)]
    board: BoardStatus


class FenceStatus(OperatorMessage):
    """One fence of an arm, and how far off it is where the arm was measured last.

    Attributes:
        name: of the fence; `itself` for the arm's own body.
        shape: box, cylinder or plane; `capsules` for the arm's own body.
        keep: out or in.
        bodies: links, tool or all.
        body: the capsule of the arm that is nearest.
        distance_m: of that capsule, below zero when the fence is entered.
        margin_m: distance that motions keep.
    """

    name: str
    shape: str
    keep: str
    bodies: str
    body: str
    distance_m: float
    margin_m: float


class Reply(OperatorMessage):
    """Outcome of a request."""

    ok: bool
    error: str = ""
    status: ServoStatus | None = None
    fences: Annotated[tuple[FenceStatus, ...], Field(strict=False)] | None = None


def make_request(kind: type[RequestT], **values: Any) -> RequestT:
    """A request with these values. Raises ConfigError naming the value that is none."""
    try:
        return kind(**values)
    except ValidationError as error:
        raise ConfigError(f"no request to the servo: {_first(error)}") from None


def decode_request(line: bytes) -> OperatorRequest:
    """The request on a line. Raises RemoteProtocolError saying what is wrong with it."""
    try:
        return _REQUEST.validate_json(line)
    except ValidationError as error:
        raise RemoteProtocolError(f"no request: {_first(error)}") from None


def decode_reply(line: bytes) -> Reply:
    """The reply on a line. Raises RemoteProtocolError saying what is wrong with it."""
    try:
        return Reply.model_validate_json(line)
    except ValidationError as error:
        raise RemoteProtocolError(f"no reply: {_first(error)}") from None


def encode(message: OperatorMessage) -> bytes:
    """A message as a line."""
    return message.model_dump_json(exclude_none=True).encode() + b"\n"


def _first(error: ValidationError) -> str:
    first = error.errors(include_url=False, include_input=False)[0]
    where = ".".join(str(part) for part in first["loc"])
    return f"{where}: {first['msg']}" if where else str(first["msg"])
