"""Machines whose arm is emulated inside the program, on virtual time: it passes while somebody waits.

One thread does it all, the same way every time; several machines share one time. What the arm is, such a machine is
told: one that follows exactly (`offline`), one of velocity amplifiers (`position_loops`), one that is ceded (`ceded`)
or one of stepping motors (`stepper`).
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from functools import cached_property
from typing import Final, Protocol

import numpy as np

from qrobot.arcl.machine.digital import set_bits
from qrobot.arcl.machine.interface import MachineSample, MachineSettings, PathKeeper, SetpointCycle
from qrobot.arcl.machine.stream_start import open_stream
from qrobot.arcl.stream import RecordKind
from qrobot.arcl.trace import done_line
from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.model.payload_judge import PayloadJudge
from qrobot.motion import MotionLimits
from qrobot.rci.link import LinkFactory
from qrobot.rci.robot_samples import RobotSamples
from qrobot.units import MM_PER_M
from qrobot.wire import Collision, Payload

START_POSE: Final = "park"
SAMPLE_MS: Final = 28.0  # VAL's, of which Figure 5 takes every second
_LONGEST_MS: Final = 100.0


class EmulatedArm(Protocol):
    """An arm inside the program; joint positions as in `MachineSettings`, shape (n,), rad (m on a sliding joint).

    Attributes:
        measures: it has encoders, so that what it measures goes into the stream.
    """

    measures: bool

    def take(self) -> Floats:
        """Take the arm; the joint positions where it stands. Raises what a link raises."""

    def follow(self, q: Floats) -> None:
        """Go to `q` within one sample. Raises ServoFault or LinkError: it cannot, and control of the arm is lost."""

    def read(self) -> tuple[Floats, Floats]:
        """Joint positions and velocities as they are measured now."""

    def narrow(self, limits: MotionLimits) -> MotionLimits:
        """The limits that motions have on this arm; no wider than those of its joints."""

    def leave(self) -> None:
        """Let go of the arm; a second call does nothing."""


class EmulatedMachine:
    """See `RobotMachine`.

    Args:
        name: of the layer, for the stream and the last line.
        settings: what it is made with.
        period_ms: sample period where the settings name none.
        make: makes the arm, from the sample period in s.

    Raises:
        MotionError: no such sample period. ConfigError: the stream cannot be written.
    """

    virtual_time = True

    def __init__(
        self, name: str, settings: MachineSettings, period_ms: float, make: Callable[[float], EmulatedArm]
    ) -> None:
        self.name, self._robot = name, settings.robot
        self._period_ms = _checked(period_ms if settings.period_ms is None else settings.period_ms)
        self.period_s = self._period_ms / MM_PER_M
        self.sample: MachineSample | None = None
        self.arm = make(self.period_s)
        self._samples = RobotSamples(self._exchange, lambda _error: self.arm.leave())
        self._ticks = 0
        self._hand = self._outputs = 0
        self._cycle: SetpointCycle | None = None
        self.stream = open_stream(settings, name, self._period_ms)

    def open(self) -> Floats:
        """See `RobotMachine.open`: it stands at its start."""
        return self.arm.take()

    def narrow(self, limits: MotionLimits) -> MotionLimits:
        """See `RobotMachine.narrow`."""
        return self.arm.narrow(limits)

    def start(self, cycle: SetpointCycle) -> None:
        """See `RobotMachine.start`: time passes from now on, beside that of the program's other machines."""
        self._cycle = cycle
        self._samples.begin(self.period_s)

    def treal(self) -> float:
        """See `RobotMachine.treal`."""
        return 0.0 if self.sample is None else self.sample.t_ms

    def lock(self) -> AbstractContextManager[object]:
        """See `RobotMachine.lock`: nobody else is there."""
        if self.error is not None:
            raise self.error
        return nullcontext()

    @property
    def error(self) -> BaseException | None:
        """See `RobotMachine.error`."""
        return self._samples.error

    def wait(self, predicate: Callable[[], bool]) -> None:
        """See `RobotMachine.wait`."""
        self._samples.wait(predicate)

    def grip(self, command: int, value: float) -> None:
        """See `RobotMachine.grip`: any command goes into the stream."""
        self._write(RecordKind.GRIPPER, [command, value])
        self._hand = command

    def write_outputs(self, first: int, count: int, value: int) -> None:
        """See `RobotMachine.write_outputs`."""
        self._outputs = set_bits(self._outputs, first, count, value)
        self._write(RecordKind.OUTPUT, [first, count, value])

    def write_analog(self, output: int, volts: float) -> None:
        """See `RobotMachine.write_analog`."""
        self._write(RecordKind.ANALOG, [output, volts])

    def tell(self, setting: Payload | Collision) -> None:
        """See `RobotMachine.tell`: nothing weighs on this arm, but what it could not carry is refused."""
        if isinstance(setting, Payload) and (objection := self._payloads.objection(setting)):
            raise MotionError(f"{self._robot.name} cannot carry that: {objection}")

    @cached_property
    def _payloads(self) -> PayloadJudge:
        return PayloadJudge(self._robot)

    def keep_path(self, keeper: PathKeeper) -> None:  # noqa: ARG002 (there is nobody who would give the arm back)
        """See `RobotMachine.keep_path`. Raises MotionError, always."""
        raise MotionError(f"the machine layer {self.name!r} cannot take an arm again that it has lost")

    def lend(self, borrower: Callable[[LinkFactory], None]) -> Floats:  # noqa: ARG002 (there are no links)
        """See `RobotMachine.lend`. Raises MotionError, always."""
        raise MotionError(
            f"teach: the arm of the machine layer {self.name!r} is inside the program, and no teach pendant reaches "
            "it; run the program on an arm, or with --lockstep"
        )

    def close(self, power_off: bool) -> None:  # noqa: ARG002 (there is no power)
        """See `RobotMachine.close`."""
        self._samples.end()
        self.arm.leave()
        if self.stream is not None:
            self.stream.close(self.treal())

    def farewell(self) -> str:
        """See `RobotMachine.farewell`."""
        return done_line(self.name, self.treal() / 1e3)

    def _exchange(self) -> None:
        """Ask for the setpoints of one sample and bring them to the arm."""
        assert self._cycle is not None  # it runs only from `start` on
        self.sample = self._measured()
        q = np.array(self._cycle(self.sample), dtype=np.float64)
        self.arm.follow(q)
        reached = self._measured()
        self.sample = replace(self.sample, q=reached.q, v=reached.v)
        if self.arm.measures:
            self._write(RecordKind.MEASURED, reached.q)
        self._write(RecordKind.JOINTS, q)
        self._ticks += 1

    def _measured(self) -> MachineSample:
        q, v = self.arm.read()
        t_ms = self._ticks * self._period_ms
        return MachineSample(t_ms, q.copy(), v.copy(), np.full_like(q, np.nan), 0, self._outputs, self._hand)

    def _write(self, kind: RecordKind, values: Floats | list[float]) -> None:
        if self.stream is not None:
            self.stream.numbers(kind, np.asarray(values, dtype=np.float64), self.treal())


def start_of(settings: MachineSettings) -> Floats:
    """Joint positions at which an arm that is made with these settings stands. Shape (n,)."""
    pose = settings.robot.poses[START_POSE] - settings.zero
    return np.array(pose if settings.start is None else settings.start, dtype=np.float64)


def _checked(period_ms: float) -> float:
    if not 1.0 <= period_ms <= _LONGEST_MS:
        raise MotionError(f"a sample period of {period_ms:g} ms; 1 to {_LONGEST_MS:g} ms are possible")
    return period_ms
