"""The duties of a machine layer: it calls the trajectory generator once per sample and brings its setpoints to an arm.

A machine is usable without the rest of ARCL: whoever gives `start` a function that answers each sample with joint
positions moves the arm.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Protocol, TypeAlias

import numpy as np

from qrobot.arcl.stream import StreamWriter
from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import LinkError, ServoFault
from qrobot.motion import MotionLimits
from qrobot.rci.link import LinkFactory
from qrobot.wire import Collision, Payload
from qrobot.wire.vocabulary import N_SENSORS


@dataclass(frozen=True, eq=False)
class MachineSample:
    """One sample of an arm, as a machine knows it; joints as in `MachineSettings`, rad and s (m on a sliding joint).

    Attributes:
        t_ms: time since the first sample.
        q, v, tau: measured positions and velocities, commanded torques (N m, N; NaN where not known). Shapes (n,).
        inputs, outputs: binary lines, line 1 in bit 0.
        hand: as commanded.
        left_out: samples before this one that were never heard of.
        override: share of the programmed speed that the operator wants, 0 to 1; 0 in a pause.
        sensors: volts at the channels of the converter; NaN where not known. Shape (8,).
        torques_known: false of drives that keep their torques to themselves; of such an arm no collision is told.
    """

    t_ms: float
    q: Floats
    v: Floats
    tau: Floats
    inputs: int = 0
    outputs: int = 0
    hand: int = 0
    left_out: int = 0
    override: float = 1.0
    sensors: Floats = field(default_factory=partial(np.full, N_SENSORS, np.nan))
    torques_known: bool = True


SetpointCycle: TypeAlias = Callable[[MachineSample], Floats]
"""Called once per sample; gives the joint setpoints, shape (n,), for the next sample period."""


@dataclass(frozen=True, eq=False)
class MachineSettings:
    """Settings of a machine.

    Attributes:
        robot: the arm.
        zero: joint positions of the robot file where those of the setpoints are 0. Shape (n,), rad (m).
        period_ms: sample period; None for the machine's own.
        stream: file for the diagnostic stream; None for none.
        program: name of the program, for the stream.
        clear_fault: clear a latched fault before power-up.
        start: where an arm stands that is not there, as setpoints; None for its park pose. Shape (n,).
        bridge: "host:port" of the arm's bridge; empty for the program's.
    """

    robot: Robot
    zero: Floats
    period_ms: float | None = None
    stream: Path | None = None
    program: str = ""
    clear_fault: bool = False
    start: Floats | None = None
    bridge: str = ""


class PathKeeper(Protocol):
    """Keeps the path of an arm over stops of the servo. The machine calls it with its lock held."""

    @property
    def reason(self) -> str:
        """Reason for which the arm stands off its path, until somebody confirms that it may go back; else empty."""

    @property
    def off_path(self) -> bool:
        """The arm is off its path: it goes back from what it met, waits, or is led back."""

    @property
    def met(self) -> ServoFault | LinkError | None:
        """The fault of an arm that has been taken again, and is back from what it met: `keep` is to be asked anew."""

    def keep(self, fault: ServoFault | LinkError, held: bool) -> bool:
        """Control of the arm would end with `fault`; true when the arm is to stand instead, and be taken again.

        `held` tells that somebody beside the program wants it at rest, or that nothing carries it any more.
        """

    def look(self, seen: MachineSample, paused: bool) -> None:
        """A sample in which the arm is off its path, and `cycle` is not called; the end of a pause confirms.

        Raises what `insist` raises.
        """

    def insist(self) -> None:
        """Raise the fault that the program was not told, once it has given the path up."""

    def may_return(self, seen: MachineSample) -> bool:
        """True once the arm, which stands, is to be taken again."""

    def lead_back(self, q: Floats) -> None:
        """The arm is held at `q` (n,), and `cycle` called again: it leads back. Raises MotionError: it cannot."""


class RobotMachine(Protocol):
    """A way to one arm.

    Attributes:
        name: of the layer.
        period_s: sample period.
        virtual_time: time passes only while somebody waits.
        stream: takes records besides the machine's own; None when there is none.
        sample: the newest; None before the first.
    """

    name: str
    period_s: float
    virtual_time: bool
    stream: StreamWriter | None
    sample: MachineSample | None

    @property
    def error(self) -> BaseException | None:
        """Error that ended control of the arm, None as long as all is well."""

    def open(self) -> Floats:
        """Take the arm. Gives the joint positions at which it is held. Shape (n,). Raises what a link raises."""

    def narrow(self, limits: MotionLimits) -> MotionLimits:
        """The limits that motions have on this machine, of an arm whose joints have `limits`: those, or narrower.

        Asked whenever the arm has been taken: when it is opened, and after it was lent.
        """

    def start(self, cycle: SetpointCycle) -> None:
        """Call `cycle` once per sample from now on, and deliver what it gives."""

    def treal(self) -> float:
        """The real-time clock: ms since the first sample."""

    def lock(self) -> AbstractContextManager[object]:
        """Held while a program touches what `cycle` touches. Raises what ended control of the arm."""

    def wait(self, predicate: Callable[[], bool]) -> None:
        """Return when `predicate`, called at every sample, is true. Raises what ended control of the arm."""

    def grip(self, command: int, value: float) -> None:
        """A gripper command. Raises MotionError: this machine's gripper does not know it."""

    def write_outputs(self, first: int, count: int, value: int) -> None:
        """Switch `count` binary outputs from line `first` on to the bits of `value`. Raises MotionError: no such."""

    def write_analog(self, output: int, volts: float) -> None:
        """Let an analogue output, from 1, show `volts`, which are within its range.

        Raises MotionError: what was asked for before was refused; this one is not asked for then.
        """

    def tell(self, setting: Payload | Collision) -> None:
        """Tell the robot its load, or how it tells collisions, and wait until it has heard.

        Raises MotionError: it is refused; nothing has changed then.
        """

    def keep_path(self, keeper: PathKeeper) -> None:
        """Let `keeper` decide from now on whether a stop of the servo ends control of the arm.

        Raises MotionError: this machine cannot take an arm again that it has lost.
        """

    def lend(self, borrower: Callable[[LinkFactory], None]) -> Floats:
        """Let go of the arm, which is at rest, until `borrower` has done with links to it, and take it again.

        What `start` was given is called no more. Gives the joint positions at which the arm is held then. Shape (n,).
        Raises what `borrower` and `open` raise; MotionError: there is no arm that somebody else could move.
        """

    def close(self, power_off: bool) -> None:
        """Let go of the arm, which is at rest. A second call does nothing."""

    def farewell(self) -> str:
        """The line that is printed when a program lets go of the arm; empty for nothing."""
