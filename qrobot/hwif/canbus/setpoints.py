"""Setpoints of a drive of CiA 402 in each cycle: a torque out of a converter word, or a position out of a reference."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from math import ceil
from typing import Final, Protocol

from qrobot.config.drives import DrivesTransport
from qrobot.hwif.canbus.ds402 import CYCLIC_POSITION, CYCLIC_TORQUE, DISABLE_VOLTAGE, QUICK_STOP, DriveState, state_of
from qrobot.hwif.operations import OP_REFERENCE, OP_WRITE, REFERENCE_PER_COUNT
from qrobot.hwif.registers import DAC, DAC_MASK, DAC_ZERO

PATIENCE_MS: Final = 20.0  # twice the period of the slowest servo
_TORQUE_LIMIT: Final = 0x7FFF
_WRAP: Final = 1 << 32  # of references and of positions


@dataclass
class DriveFeedback:
    """Feedback of a drive: status word, position in increments, counts to add to it.

    The position goes on where that of the drive, of 32 bits, begins anew.
    """

    loaded: int
    status: int = 0
    position: int = 0

    def hear(self, status: int, position: int) -> None:
        """Take over what the drive shows."""
        self.status = status
        self.position += _signed(position - self.position)

    @property
    def state(self) -> DriveState:
        """State that its status word shows."""
        return state_of(self.status)


class DriveSetpoints(Protocol):
    """Interface of the setpoints of an arm's drives in one mode of operation.

    Attributes:
        mode: of operation. mode_name: in the words of CiA 402.
        frame: RPDO 1, control word and setpoint.
        leaving: control word for a drive that cannot be led any more because another one is silent.
        silent: nobody says any more where the motors are to be; they have to be stopped, until power is taken away.
    """

    mode: int
    mode_name: str
    frame: struct.Struct
    leaving: int
    silent: bool

    def take(self, kind: int, offset: int, value: int) -> None:
        """Look at an operation."""

    def begin(self, driven: bool) -> None:
        """A cycle begins; `driven`: every drive is in operation, and is to be."""

    def value(self, channel: int, drive: DriveFeedback, driven: bool, /) -> int:
        """Setpoint of a drive in this cycle."""

    def forget(self) -> None:
        """The motors are not to be driven: what was said so far is void."""


class TorqueSetpoints:
    """Cyclic synchronous torque: thousandths of the rated torque, zero until every drive is in operation."""

    mode = CYCLIC_TORQUE
    mode_name = "cyclic synchronous torque"
    frame = struct.Struct("<Hh")
    leaving = DISABLE_VOLTAGE
    silent = False  # what falls silent here is the servo, and the guardian takes the power away

    def __init__(self, transport: DrivesTransport) -> None:
        self._full = transport.torque_permille
        self._words = [DAC_ZERO] * len(transport.nodes)

    def take(self, kind: int, offset: int, value: int) -> None:
        """See `DriveSetpoints`: converter words."""
        channel = (offset - DAC) // 2
        if kind == OP_WRITE and 0 <= channel < len(self._words):
            self._words[channel] = value & DAC_MASK

    def begin(self, driven: bool) -> None:
        """See `DriveSetpoints`."""

    def value(self, channel: int, _drive: DriveFeedback, driven: bool, /) -> int:
        """See `DriveSetpoints`."""
        torque = round((DAC_ZERO - self._words[channel]) * self._full[channel] / DAC_ZERO)
        return min(max(torque, -_TORQUE_LIMIT), _TORQUE_LIMIT) if driven else 0

    def forget(self) -> None:
        """See `DriveSetpoints`. Words stay: the servo has set them, at zero, before it asks for power."""


class PositionSetpoints:
    """Cyclic synchronous position: increments of the drive.

    A drive that is not in operation is told the position it has, so that none moves when it is switched on; then it
    holds that until the first reference comes. References wrap like the counters they are made of: what is meant is
    the nearest position to where the drive is.
    """

    mode = CYCLIC_POSITION
    mode_name = "cyclic synchronous position"
    frame = struct.Struct("<Hi")
    leaving = QUICK_STOP

    def __init__(self, transport: DrivesTransport) -> None:
        n = len(transport.nodes)
        self.silent = False
        self._increments = transport.increments_per_count
        self._patience = ceil(PATIENCE_MS / transport.period_ms)
        self._references: list[int | None] = [None] * n
        self._targets = [0] * n
        self._quiet = 0

    def take(self, kind: int, offset: int, value: int) -> None:
        """See `DriveSetpoints`: references."""
        if kind == OP_REFERENCE and offset < len(self._references):
            self._references[offset], self._quiet = value, -1

    def begin(self, driven: bool) -> None:
        """See `DriveSetpoints`; cycles without a reference are counted once there has been one."""
        if driven and any(reference is not None for reference in self._references):
            self._quiet += 1
        self.silent = self.silent or self._quiet > self._patience

    def value(self, channel: int, drive: DriveFeedback, driven: bool, /) -> int:
        """See `DriveSetpoints`."""
        reference = self._references[channel]
        if drive.state is not DriveState.ENABLED:
            self._targets[channel] = _signed(drive.position)
        elif driven and reference is not None:
            self._targets[channel] = self._target(drive, self._increments[channel], reference)
        return self._targets[channel]

    def forget(self) -> None:
        """See `DriveSetpoints`."""
        self.silent, self._quiet = False, 0
        self._references = [None] * len(self._references)

    def _target(self, drive: DriveFeedback, increments: float, reference: int) -> int:
        here = round((drive.position / increments + drive.loaded) * REFERENCE_PER_COUNT)
        ahead = _signed(reference - here)
        return _signed(drive.position + round(ahead / REFERENCE_PER_COUNT * increments))


def _signed(number: int) -> int:
    return (number + _WRAP // 2) % _WRAP - _WRAP // 2


def setpoints_of(transport: DrivesTransport) -> DriveSetpoints:
    """Make the setpoints of the mode that a deployment file chooses."""
    return PositionSetpoints(transport) if transport.mode == "position" else TorqueSetpoints(transport)
