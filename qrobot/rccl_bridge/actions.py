"""Actions that a session decides; `carry_out` performs them, for the server and for lock-step alike."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import TypeAlias

from qrobot.errors import LinkError
from qrobot.rccl_bridge.servo_interface import RobotPort, SetpointFrame
from qrobot.wire import AnalogOutputs, Collision, Payload


@dataclass(frozen=True, slots=True)
class SendBytes:
    """Bytes for the client."""

    data: bytes


@dataclass(frozen=True, slots=True)
class Forward:
    """A frame for the servo."""

    frame: SetpointFrame


@dataclass(frozen=True, slots=True)
class BareRequest:
    """Requests of a frame whose setpoints nobody can follow."""

    frame: SetpointFrame


@dataclass(frozen=True, slots=True)
class StopArm:
    """A controlled stop, and why."""

    reason: str


@dataclass(frozen=True, slots=True)
class Close:
    """The end of the client's connection, and why."""

    reason: str


@dataclass(frozen=True, slots=True)
class TakePowerAway:
    """A controlled stop, and no arm power after it; why."""

    reason: str


@dataclass(frozen=True, slots=True)
class NameSignals:
    """Names of the program's numbers."""

    names: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class TakePayload:
    """A payload to reckon with."""

    payload: Payload


@dataclass(frozen=True, slots=True)
class TakeCollision:
    """Thresholds and reaction of collisions from now on."""

    collision: Collision


@dataclass(frozen=True, slots=True)
class ForgetCollision:
    """The robot file's thresholds count again where a program told others."""


@dataclass(frozen=True, slots=True)
class TakeAnalog:
    """Volts of analogue outputs from now on."""

    analog: AnalogOutputs


@dataclass(frozen=True, slots=True)
class Note:
    """A line for the bridge's log."""

    text: str


ServoAction: TypeAlias = (
    Forward
    | BareRequest
    | StopArm
    | TakePowerAway
    | NameSignals
    | TakePayload
    | TakeCollision
    | ForgetCollision
    | TakeAnalog
)
Action: TypeAlias = SendBytes | ServoAction | Note | Close


@dataclass(frozen=True, slots=True)
class SessionOutcome:
    """Rest for the owner of the connection: bytes to write, then, unless `closed` is "", to close it; lines to log."""

    data: bytes
    closed: str
    notes: tuple[str, ...] = ()


def carry_out(actions: Iterable[Action], port: RobotPort) -> SessionOutcome:
    """Do what concerns the servo, return what concerns the client.

    A servo that went away in between is no error here: the next tick finds out and tells the client.
    """
    data, closed, notes = b"", "", list[str]()
    for action in actions:
        match action:
            case SendBytes():
                data += action.data
            case Close():
                closed = action.reason
            case Note():
                notes.append(action.text)
            case _:
                _tell_servo(action, port)
    return SessionOutcome(data, closed, tuple(notes))


def _tell_servo(action: ServoAction, port: RobotPort) -> None:
    with suppress(LinkError):
        match action:
            case Forward():
                port.write_setpoint(action.frame)
            case BareRequest():
                port.write_requests(action.frame)
            case StopArm():
                port.request_stop()
            case TakePowerAway():
                port.request_power_off()
            case NameSignals():
                port.name_signals(action.names)
            case TakePayload():
                port.write_payload(action.payload)
            case TakeCollision():
                port.write_collision(action.collision)
            case ForgetCollision():
                port.forget_collision()
            case TakeAnalog():
                port.write_analog(action.analog)
