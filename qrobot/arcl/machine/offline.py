"""The off-line machine: there is no arm. Setpoints and requests go into a stream, and time passes while somebody waits.

The arm follows every setpoint exactly and at once. One thread does it all, the same way every time; several machines
share one time.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import Final

import numpy as np

from qrobot.arcl.machine import shared_time
from qrobot.arcl.machine.digital import set_bits
from qrobot.arcl.machine.interface import MachineSample, MachineSettings, SetpointCycle
from qrobot.arcl.machine.stream_start import open_stream
from qrobot.arcl.stream import RecordKind
from qrobot.arcl.trace import done_line
from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.units import MM_PER_M

OFFLINE_PERIOD_MS: Final = 56.0  # dT in Figure 5 of the paper
START_POSE: Final = "park"
_LONGEST_MS: Final = 100.0


class OfflineMachine:
    """See `RobotMachine`.

    Args:
        settings: what it is made with.

    Raises:
        MotionError: no such sample period. ConfigError: the stream cannot be written.
    """

    name = "offl"
    virtual_time = True

    def __init__(self, settings: MachineSettings) -> None:
        period_ms = OFFLINE_PERIOD_MS if settings.period_ms is None else settings.period_ms
        if not 1.0 <= period_ms <= _LONGEST_MS:
            raise MotionError(f"off line: a sample period of {period_ms:g} ms; 1 to {_LONGEST_MS:g} ms are possible")
        self.period_s = period_ms / MM_PER_M
        self.sample: MachineSample | None = None
        pose = settings.robot.poses[START_POSE] - settings.zero
        self._q = np.array(pose if settings.start is None else settings.start, dtype=np.float64)
        self._v = np.zeros_like(self._q)
        self._period_ms = period_ms
        self._ticks = 0
        self._hand = self._outputs = 0
        self._cycle: SetpointCycle | None = None
        self.sampling = False
        self.error: BaseException | None = None
        self.stream = open_stream(settings, self.name, period_ms)

    def open(self) -> Floats:
        """See `RobotMachine.open`: it stands at its start."""
        return self._q.copy()

    def start(self, cycle: SetpointCycle) -> None:
        """See `RobotMachine.start`: time passes from now on, beside that of the program's other machines."""
        self._cycle = cycle
        shared_time.join(self)

    def treal(self) -> float:
        """See `RobotMachine.treal`."""
        return 0.0 if self.sample is None else self.sample.t_ms

    def lock(self) -> AbstractContextManager[object]:
        """See `RobotMachine.lock`: nobody else is there."""
        if self.error is not None:
            raise self.error
        return nullcontext()

    def wait(self, predicate: Callable[[], bool]) -> None:
        """See `RobotMachine.wait`."""
        shared_time.wait(self, predicate)

    def grip(self, command: int, value: float) -> None:
        """See `RobotMachine.grip`: any command goes into the stream."""
        self._write(RecordKind.GRIPPER, [command, value])
        self._hand = command

    def write_outputs(self, first: int, count: int, value: int) -> None:
        """See `RobotMachine.write_outputs`."""
        self._outputs = set_bits(self._outputs, first, count, value)
        self._write(RecordKind.OUTPUT, [first, count, value])

    def close(self, power_off: bool) -> None:  # noqa: ARG002 (there is no power)
        """See `RobotMachine.close`."""
        shared_time.leave(self)
        if self.stream is not None:
            self.stream.close(self.treal())

    def farewell(self) -> str:
        """See `RobotMachine.farewell`."""
        return done_line(self.name, self.treal() / 1e3)

    @property
    def elapsed_ms(self) -> float:
        """See `SteppedMachine.elapsed_ms`."""
        return self._ticks * self._period_ms

    def step(self) -> None:
        """See `SteppedMachine.step`."""
        self.sample = MachineSample(
            self.elapsed_ms,
            self._q.copy(),
            self._v.copy(),
            np.full_like(self._q, np.nan),
            0,
            self._outputs,
            self._hand,
        )
        self.sampling = True
        try:
            assert self._cycle is not None  # it runs only from `start` on
            q = np.array(self._cycle(self.sample), dtype=np.float64)
        except BaseException as error:
            self.error = error
            return
        finally:
            self.sampling = False
        self._v, self._q = (q - self._q) / self.period_s, q
        self.sample = replace(self.sample, q=q.copy(), v=self._v.copy())
        self._write(RecordKind.JOINTS, q)
        self._ticks += 1

    def _write(self, kind: RecordKind, values: Floats | list[float]) -> None:
        if self.stream is not None:
            self.stream.numbers(kind, np.asarray(values, dtype=np.float64), self.treal())
