"""What the packets say. Bytes are the business of `codec`, order that of `states`.

Joint vectors are tuples of n floats, SI units (rad or m, rad/s or m/s, N m or N). `seq`, `ack` and `t_ns` are those of
the header (see `layout`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, TypeAlias

from qrobot.faultcodes import NO_JOINT
from qrobot.wire.vocabulary import ClientRole, RobotFlag

Values: TypeAlias = tuple[float, ...]

UNKNOWN_FORCE: Final[Values] = (math.nan,) * 6


@dataclass(frozen=True, slots=True)
class Hello:
    """First packet of a client; `period_us` 0 takes the server's period.

    A commander names the robot it was written for; an observer may leave the name empty.
    """

    role: ClientRole
    robot: str
    program: str = ""
    period_us: int = 0
    auth: bytes = b""
    t_ns: int = 0


@dataclass(frozen=True, slots=True)
class Welcome:
    """The client is in: `role` granted, joint count, sample period and name of the robot."""

    role: ClientRole
    robot: str
    n: int
    period_us: int
    t_ns: int = 0


@dataclass(frozen=True, slots=True)
class Command:
    """Setpoints and requests for one sample period.

    Attributes:
        seq: sample period it is for: the seq of the STATE it answers, or a count of the client's own periods.
        modes: values of `JointMode`. Shape (n,).
        setpoints: rad or m in position mode, N m or N in torque mode. Shape (n,).
        power: level of the request for arm power; begin with what STATE says to leave it as it is.
        clear_fault, stop: act once each time they are raised.
        stream: names one run of setpoints; after any stop the arm follows only a new one.
        outputs: what the binary outputs are to be, output 1 in bit 0; begin with what STATE says.
        ack: seq of the newest STATE received.
        t_ns: the client's clock.
        hold_to_run: this stream moves the arm only while a key is held; for as long as the stream lasts.
        key_held: the key is held now; said again at least every 100 ms.
    """

    seq: int
    modes: tuple[int, ...]
    setpoints: Values
    power: bool = False
    clear_fault: bool = False
    stop: bool = False
    stream: int = 0
    hand: int = 0
    outputs: int = 0
    ack: int = 0
    t_ns: int = 0
    hold_to_run: bool = False
    key_held: bool = False

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.modes)


@dataclass(frozen=True, slots=True)
class RobotState:
    """One sample of the robot, as the servo tells it.

    Attributes:
        t_ns: time of the sample on the server's monotonic clock.
        mode: a `RobotMode`; plain int, so that a mode of a newer servo gets through.
        fault: `FaultCode` that latched the FAULT mode, 0 for none.
        event, event_joint: newest code of any kind and the joint (from 0) it speaks of, NO_JOINT for none.
        flags: `RobotFlag` bits of the servo.
        q, v, tau, q_setpoint: measured position and velocity, commanded torque, momentary setpoint. Shape (n,).
        force: on the wrist sensor in its frame, fx fy fz mx my mz, N and N m; NaN where it is not known. Shape (6,).
        outputs: binary outputs in force, output 1 in bit 0; a stop may have switched some off that are asked for.
    """

    t_ns: int
    mode: int
    q: Values
    v: Values
    tau: Values
    q_setpoint: Values
    fault: int = 0
    event: int = 0
    event_joint: int = NO_JOINT
    flags: int = 0
    late_cycles: int = 0
    missed_frames: int = 0
    inputs: int = 0
    hand: int = 0
    force: Values = (0.0,) * 6
    outputs: int = 0

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.q)

    @property
    def powered(self) -> bool:
        """Arm power is on."""
        return bool(self.flags & RobotFlag.POWERED)

    @property
    def calibrated(self) -> bool:
        """The counters are calibrated."""
        return bool(self.flags & RobotFlag.CALIBRATED)

    @property
    def estop_ok(self) -> bool:
        """The emergency stop is released."""
        return bool(self.flags & RobotFlag.ESTOP_OK)

    @property
    def at_rest(self) -> bool:
        """The arm stands still and no motion is pending."""
        return bool(self.flags & RobotFlag.AT_REST)


@dataclass(frozen=True, slots=True)
class State:
    """A sample of the robot on its way to one client; the header's t_ns is `robot.t_ns`.

    Attributes:
        seq: sample period since the connection began; a gap means that samples were left out.
        ack: seq of the newest COMMAND of this client that was taken.
        dropped: COMMANDs of this client that were refused: repeated, out of order or invalid.
        you_command: this client holds the commander's lease.
        commanded: somebody does.
    """

    seq: int
    robot: RobotState
    ack: int = 0
    dropped: int = 0
    you_command: bool = False
    commanded: bool = False


@dataclass(frozen=True, slots=True)
class WireError:
    """Something is wrong with the connection; when `fatal`, the server closes it."""

    code: int
    text: str
    fatal: bool
    t_ns: int = 0


@dataclass(frozen=True, slots=True)
class Bye:
    """Orderly end."""

    text: str = ""
    t_ns: int = 0


Packet: TypeAlias = Hello | Welcome | Command | State | WireError | Bye
