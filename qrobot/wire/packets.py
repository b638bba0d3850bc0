"""Contents of the packets. Bytes are the business of `codec`, order that of `states`.

Joint vectors are tuples of n floats, SI units (rad or m, rad/s or m/s, N m or N). `seq`, `ack` and `t_ns` are those of
the header (see `layout`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, TypeAlias

from qrobot.wire.robot_state import StateTable, again
from qrobot.wire.vocabulary import N_ANALOG_OUTPUTS, N_SENSORS, N_SIGNALS, ClientRole

Values: TypeAlias = tuple[float, ...]

UNKNOWN_FORCE: Final[Values] = (math.nan,) * 6
NO_SIGNALS: Final[Values] = (math.nan,) * N_SIGNALS


@dataclass(frozen=True, slots=True)
class Hello:
    """First packet of a client; `period_us` 0 takes the server's period.

    A commander names the robot it was written for; an observer may leave the name empty. Who commands several arms asks
    for samples `in_step`, at whole multiples of the period on the bridge's clock.
    """

    role: ClientRole
    robot: str
    program: str = ""
    period_us: int = 0
    auth: bytes = b""
    t_ns: int = 0
    in_step: bool = False


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
        key_held: the key is held now; when that has not been said for 70 ms the arm stops.
        signals: numbers that the program tells, in the order of the names of its `Signals`; NaN for none. Shape (8,).
        path_waits: the arm stands off the program's path, and goes back when somebody confirms; for people.
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
    signals: Values = NO_SIGNALS
    path_waits: bool = False

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.modes)


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotState(StateTable[Values]):
    """One sample of the robot as packets carry it, see `wire.robot_state`."""

    force: Values = again(StateTable, "force", (0.0,) * 6)
    sensors: Values = again(StateTable, "sensors", (0.0,) * N_SENSORS)
    analog_outputs: Values = again(StateTable, "analog_outputs", (0.0,) * N_ANALOG_OUTPUTS)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.q)


@dataclass(frozen=True, slots=True)
class State:
    """A sample of the robot on its way to one client; the header's t_ns is `robot.t_ns`.

    Attributes:
        seq: sample period since the connection began, or `in_step`; a gap means that samples were left out.
        ack: seq of the newest COMMAND of this client that was taken.
        dropped: COMMANDs of this client that were refused: repeated, out of order or invalid.
        you_command: this client holds the commander's lease.
        commanded: somebody does.
        path_waits: their arm stands off its path, until somebody confirms that it may go back.
        in_step: `seq` is the sample period of the bridge's clock: samples of two arms of one machine that have the same
            period and the same number are of one instant.
    """

    seq: int
    robot: RobotState
    ack: int = 0
    dropped: int = 0
    you_command: bool = False
    commanded: bool = False
    path_waits: bool = False
    in_step: bool = False


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


@dataclass(frozen=True, slots=True)
class Stop:
    """A stop on the path that anybody may ask for; with `power_off` arm power is taken away after it."""

    power_off: bool = False
    t_ns: int = 0


@dataclass(frozen=True, slots=True)
class Signals:
    """Names of the numbers in `Command.signals` from now on, in their order; at most 8."""

    names: tuple[str, ...]
    t_ns: int = 0


@dataclass(frozen=True, slots=True)
class Payload:
    """A load that the arm carries.

    Attributes:
        mass: kg; 0 for nothing.
        centre: centre of mass in the frame of the flange, m. Shape (3,).
        inertia: about that centre, along the axes of the flange, kg m^2: xx yy zz xy xz yz.
    """

    mass: float
    centre: Values = (0.0,) * 3
    inertia: Values = (0.0,) * 6
    t_ns: int = 0


@dataclass(frozen=True, slots=True)
class Collision:
    """Thresholds of collisions from now on, and what follows them.

    Attributes:
        thresholds: torque of each joint that nobody commanded, N m (N); 0 for the robot file's. Shape (n,).
        reaction: a `CollisionReaction`.
    """

    thresholds: Values
    reaction: int = 0
    t_ns: int = 0


@dataclass(frozen=True, slots=True)
class AnalogOutputs:
    """Analogue outputs from now on: volts of outputs 1 to 8, NaN for those that stay as they are. Shape (8,)."""

    volts: Values
    t_ns: int = 0


def analog_output(output: int, volts: float) -> AnalogOutputs:
    """The packet by which one analogue output, from 1, shows other volts."""
    return AnalogOutputs(tuple(volts if k == output else math.nan for k in range(1, N_ANALOG_OUTPUTS + 1)))


Packet: TypeAlias = (
    Hello | Welcome | Command | State | WireError | Bye | Stop | Signals | Payload | Collision | AnalogOutputs
)
