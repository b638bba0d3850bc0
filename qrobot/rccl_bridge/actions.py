"""Actions that a session decides; `carry_out` performs them, for the server and for lock-step alike."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeAlias

from qrobot.errors import LinkError
from qrobot.rccl_bridge.servo_interface import RobotPort, SetpointFrame


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


Action: TypeAlias = SendBytes | Forward | BareRequest | StopArm | Close


@dataclass(frozen=True, slots=True)
class SessionOutcome:
    """Rest for the owner of the connection: bytes to write, then, unless `closed` is "", to close it."""

    data: bytes
    closed: str


def carry_out(actions: Iterable[Action], port: RobotPort) -> SessionOutcome:
    """Do what concerns the servo, return what concerns the client.

    A servo that went away in between is no error here: the next tick finds out and tells the client.
    """
    data, closed = b"", ""
    for action in actions:
        match action:
            case SendBytes():
                data += action.data
            case Close():
                closed = action.reason
            case _:
                _tell_servo(action, port)
    return SessionOutcome(data, closed)


def _tell_servo(action: Forward | BareRequest | StopArm, port: RobotPort) -> None:
    try:
        if isinstance(action, Forward):
            port.write_setpoint(action.frame)
        elif isinstance(action, BareRequest):
            port.write_requests(action.frame)
        else:
            port.request_stop()
    except LinkError:
        return
