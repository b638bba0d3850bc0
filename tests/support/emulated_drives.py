"""Drives of CiA 402 made of an emulated board: what they take goes to its converters, what it counts they tell.

Frames come and go through `take`, so that whoever serves them chooses the wire and the clock. The board behind them
moves on at each SYNC.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from qrobot.hwif.bus import Endpoint
from qrobot.hwif.canbus.drives import FROM_DRIVE
from qrobot.hwif.canbus.ds402 import (
    CYCLIC_POSITION,
    CYCLIC_TORQUE,
    DEVICE_TYPE,
    DISABLE_VOLTAGE,
    ENABLE_OPERATION,
    ERROR_CODE,
    FAULT_RESET,
    MODE_SHOWN,
    MODE_WANTED,
    PROFILE,
    QUICK_STOP,
    SHUTDOWN,
    SWITCH_ON,
    DriveState,
)
from qrobot.hwif.canbus.frames import EMCY, HEARTBEAT, NMT, RPDO, SDO_ANSWER, SDO_ASK, SYNC, TPDO
from qrobot.hwif.canbus.link import ABORTED, DOWNLOAD, DOWNLOADED, SDO, START, UPLOAD, UPLOADED
from qrobot.hwif.canbus.setpoints import PositionSetpoints, TorqueSetpoints
from qrobot.hwif.image import IMAGE_ENC_COUNT, make_image
from qrobot.hwif.operations import OP_WRITE
from qrobot.hwif.registers import (
    DAC,
    DAC_ZERO,
    DISCRETE,
    DISCRETE_HAND_RELAXED,
    DISCRETE_POWER,
)
from tests.support.drive_loop import PositionLoop

NO_OBJECT: Final = 0x06020000  # abort codes of CiA 301, table 22
WRONG_VALUE: Final = 0x06090030
VOLTAGE: Final = 0x10  # bit of the status word: there is power to switch on
LOST_SYNC: Final = 0x8100  # error code: communication
_EMERGENCY: Final = struct.Struct("<HB5x")
_COMMANDS: Final = 0x8F  # bits of the control word that make the state machine move
SendFrame = Callable[[int, bytes], None]

# Transitions of CiA 402 (table 28): where a control word leads from where.
_STEPS: Final = {
    (DriveState.SWITCH_ON_DISABLED, SHUTDOWN): DriveState.READY,
    (DriveState.READY, SWITCH_ON): DriveState.SWITCHED_ON,
    (DriveState.SWITCHED_ON, ENABLE_OPERATION): DriveState.ENABLED,
    (DriveState.ENABLED, SWITCH_ON): DriveState.SWITCHED_ON,
    (DriveState.ENABLED, SHUTDOWN): DriveState.READY,
    (DriveState.SWITCHED_ON, SHUTDOWN): DriveState.READY,
    (DriveState.ENABLED, QUICK_STOP): DriveState.QUICK_STOPPED,
}
_LIVE: Final = (DriveState.READY, DriveState.SWITCHED_ON, DriveState.ENABLED, DriveState.QUICK_STOPPED)


@dataclass
class EmulatedDrive:
    """One drive: its state machine, its setpoint, its position in increments.

    Attributes:
        torque: target torque, thousandths of the rated one. target: position, increments.
        loop: its own, for position mode; a drive without one has no such mode.
        profile: of the device, as its type tells it.
    """

    state: DriveState = DriveState.SWITCH_ON_DISABLED
    torque: int = 0
    target: int = 0
    position: int = 0
    mode: int = 0
    error: int = 0
    operational: bool = False
    loop: PositionLoop | None = None
    profile: int = PROFILE

    @property
    def modes(self) -> tuple[int, ...]:
        """Modes of operation it has."""
        return (CYCLIC_TORQUE,) if self.loop is None else (CYCLIC_TORQUE, CYCLIC_POSITION)

    def command(self, data: bytes) -> None:
        """Act on RPDO 1, as it is mapped for the mode."""
        layout = PositionSetpoints.frame if self.mode == CYCLIC_POSITION else TorqueSetpoints.frame
        if len(data) < layout.size:
            return
        control, setpoint = layout.unpack_from(data)
        self.control(control)
        if self.mode == CYCLIC_POSITION:
            self.target = setpoint
        else:
            self.torque = setpoint

    def control(self, word: int) -> None:
        """Act on a control word."""
        command = word & _COMMANDS
        if self.state is DriveState.FAULT:
            if word & FAULT_RESET:
                self.state, self.error = DriveState.SWITCH_ON_DISABLED, 0
        elif command == DISABLE_VOLTAGE and self.state in _LIVE:
            self.state = DriveState.SWITCH_ON_DISABLED
        else:
            self.state = _STEPS.get((self.state, command), self.state)

    def fail(self, error: int) -> None:
        """Something breaks in the drive."""
        self.state, self.error, self.torque = DriveState.FAULT, error, 0

    @property
    def status(self) -> int:
        """The status word."""
        return self.state.value[1] | VOLTAGE

    @property
    def driving(self) -> bool:
        """The motor is in the drive's hands: in operation, or led to a stop, which only a position loop can do."""
        stopping = self.state is DriveState.QUICK_STOPPED and self.mode == CYCLIC_POSITION
        return self.state is DriveState.ENABLED or stopping

    def next_torque(self) -> int:
        """What reaches the motor in the next cycle."""
        if self.loop is not None and not (self.driving and self.mode == CYCLIC_POSITION):
            self.loop.rest(self.position)
        if not self.driving:
            return 0
        if self.loop is None or self.mode == CYCLIC_TORQUE:
            return self.torque
        if self.state is DriveState.ENABLED:
            return self.loop.follow(self.target, self.position)
        return self.loop.slow_down(self.position)


@dataclass
class EmulatedDrives:
    """The drives of an arm on one CAN interface.

    Attributes:
        end: the emulated board that is the arm.
        send: puts a frame on the wire.
        nodes, torque_permille, increments_per_count: as in the deployment file; the rated torque of a drive follows.
        loops: their position loops; without any they have torque mode alone.
    """

    end: Endpoint
    send: SendFrame
    nodes: Sequence[int]
    torque_permille: Sequence[float]
    increments_per_count: Sequence[float]
    loops: Sequence[PositionLoop | None] = ()
    drives: list[EmulatedDrive] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.drives = [EmulatedDrive(loop=loop) for loop in self.loops or (None,) * len(self.nodes)]
        self._image = make_image()
        self.end.read_image(self._image)
        self._words = self._counts()
        self._turned = list(self._words)
        self._show()

    def boot(self) -> None:
        """Tell that they are there."""
        for node in self.nodes:
            self.send(HEARTBEAT + node, b"\0")

    def take(self, can_id: int, data: bytes) -> None:
        """Act on a frame; what means nothing is passed over."""
        if can_id == NMT and len(data) == 2:
            self._command(*data)
        elif can_id == SYNC:
            self._step()
        elif can_id - SDO_ASK in self.nodes and len(data) == SDO.size:
            self._serve(can_id - SDO_ASK, data)
        elif can_id - RPDO[0] in self.nodes:
            drive = self._drive(can_id - RPDO[0])
            if drive.operational:
                drive.command(data)

    def fail(self, node: int, error: int) -> None:
        """Let one drive fail, as it tells by an emergency message."""
        self._drive(node).fail(error)
        self.send(EMCY + node, _EMERGENCY.pack(error, 1))

    def lose_sync(self) -> None:
        """SYNC has stayed away: every drive that gives torque stops by itself, and the arm has no power any more."""
        for node, drive in zip(self.nodes, self.drives, strict=True):
            if drive.driving:
                self.fail(node, LOST_SYNC)
        self._move()

    # ------------------------------------------------------------------------------------------------------ inside

    def _step(self) -> None:
        self._move()
        self.tell()

    def _drive(self, node: int) -> EmulatedDrive:
        return self.drives[self.nodes.index(node)]

    def _command(self, command: int, node: int) -> None:
        for at, drive in zip(self.nodes, self.drives, strict=True):
            if node in (0, at):
                drive.operational = command == START
                if not drive.operational:
                    drive.control(DISABLE_VOLTAGE)

    def tell(self) -> None:
        """Send status word and position of each drive: after a SYNC, and unasked."""
        for node, drive in zip(self.nodes, self.drives, strict=True):
            if drive.operational:
                self.send(TPDO[0] + node, FROM_DRIVE.pack(drive.status, drive.position))

    def _move(self) -> None:
        """The arm has power while every drive has its motor."""
        power = all(drive.driving for drive in self.drives)
        rows = [
            (OP_WRITE, DAC + 2 * channel, DAC_ZERO - round(drive.next_torque() * DAC_ZERO / full))
            for channel, (drive, full) in enumerate(zip(self.drives, self.torque_permille, strict=True))
        ]
        rows.append((OP_WRITE, DISCRETE, DISCRETE_HAND_RELAXED | DISCRETE_POWER * power))
        self.end.apply(np.array(rows, np.int64))
        self.end.read_image(self._image)
        self._show()

    def _counts(self) -> list[int]:
        first = IMAGE_ENC_COUNT
        return [int(word) for word in self._image[first : first + len(self.nodes)]]

    def _show(self) -> None:
        """Positions do not wrap where the board's counters do."""
        for channel, word in enumerate(self._counts()):
            self._turned[channel] += (word - self._words[channel] + 0x8000 & 0xFFFF) - 0x8000
            self._words[channel] = word
            self.drives[channel].position = round(self._turned[channel] * self.increments_per_count[channel])

    def _serve(self, node: int, data: bytes) -> None:
        command, index, sub, value = SDO.unpack(data)
        answer, number = self._service(self._drive(node), command, index, value)
        self.send(SDO_ANSWER + node, SDO.pack(answer, index, sub, number))

    def _service(self, drive: EmulatedDrive, command: int, index: int, value: int) -> tuple[int, int]:
        shown = {DEVICE_TYPE: drive.profile, MODE_SHOWN: drive.mode, ERROR_CODE: drive.error}
        if command == UPLOAD and index in shown:
            return UPLOADED, shown[index]
        if command in DOWNLOAD.values() and index == MODE_WANTED:
            if value not in drive.modes:
                return ABORTED, WRONG_VALUE
            drive.mode = value
            return DOWNLOADED, 0
        return ABORTED, NO_OBJECT
