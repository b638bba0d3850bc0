"""Separate drives (CiA 402) that look like a board: a robot with modern drives under the same servo.

Each joint has a drive in cyclic synchronous torque or position mode; all work on one SYNC. To the drives go control
word and setpoint (RPDO 1), from them come status word and actual position (TPDO 1). Of a board's registers there are

* DAC: the target torque, `torque_permille` thousandths of the rated one at +10 V (the all-zero word). In position mode
  they mean nothing, and the servo's references are the target (setpoints.py);
* ENC_COUNT: the actual position in counts, plus what ENC_LOAD has put there;
* DISCRETE bit 0 and STATUS bit 15: arm power is on while every drive is in OPERATION ENABLED. A drive that leaves it
  takes the others along, and power has to be asked for anew (drive_power.py);
* STATUS bit 0: no drive has stopped by itself (QUICK STOP ACTIVE);
* the scratch bits, kept here. With absolute encoders the arm is calibrated from the start; with others it is not any
  more once a drive was lost, for nobody knows whether that has kept its position.

In position mode counters cannot be loaded while the drives are in operation, and drives to which nobody says any more
where to be are told to QUICK STOP.

When one drive falls silent those that still hear are switched off, in position mode stopped quickly, at once and again
before every attempt to find them all: no servo and no guardian can tell them meanwhile. A process that has just
started switches each off once it has said that it is a drive.

There is no converter: a conversion is never done, and no index pulse is ever seen.
"""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Callable, Collection
from contextlib import suppress
from typing import Final

from qrobot.arrays import Words
from qrobot.config.drives import DrivesTransport
from qrobot.errors import LinkError, ProtocolError, RemoteProtocolError
from qrobot.hwif.bus import BoardFacts, Operations
from qrobot.hwif.canbus.drive_power import DrivesPower
from qrobot.hwif.canbus.ds402 import (
    CYCLIC_POSITION,
    DEVICE_TYPE,
    DISABLE_VOLTAGE,
    MODE_SHOWN,
    MODE_WANTED,
    PROFILE,
    QUICK_STOP,
    DriveState,
)
from qrobot.hwif.canbus.frames import RPDO, SYNC, TPDO
from qrobot.hwif.canbus.interface import load_can
from qrobot.hwif.canbus.link import CanLink
from qrobot.hwif.canbus.setpoints import DriveFeedback, setpoints_of
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_ENC_COUNT, IMAGE_INPUTS, IMAGE_STATUS, IMAGE_T_NS
from qrobot.hwif.operations import OP_WRITE
from qrobot.hwif.registers import (
    DISCRETE,
    DISCRETE_CALIBRATED,
    DISCRETE_POWER,
    ENC_LOAD,
    SCRATCH_BITS,
    STATUS_ADC_BUSY,
    STATUS_ESTOP_OK,
    STATUS_INDEX,
    STATUS_POWER,
)
from qrobot.realtime.deadline import Deadline
from qrobot.report import Report
from qrobot.units import MS_PER_S

FROM_DRIVE: Final = struct.Struct("<Hi")  # status word, actual position


class DrivesBus:
    """The drives of one arm as a `Bus`.

    Args:
        transport: where they are, and what their numbers mean.
        clock: time of an image, ns, once it has come; by default that of SYNC.
        patience_ms: the answer to a SYNC is waited for no longer, whatever the transport says: all drives keep their
            last torque as long.
        report: takes a line when one drive is the reason that all are switched off, or that power does not come on.

    Attributes:
        link: its `timeout_s` may be changed.
    """

    def __init__(
        self,
        transport: DrivesTransport,
        clock: Callable[[], int] | None = None,
        patience_ms: float = math.inf,
        report: Report = lambda _line: None,
    ) -> None:
        self.name = f"CAN {transport.interface}:{transport.channel}, {len(transport.nodes)} drives"
        self._transport, self._now_ns, self._virtual_time = transport, clock or time.monotonic_ns, clock is not None
        timeout_s = min(transport.timeout_ms, patience_ms) / MS_PER_S
        self.link = CanLink(transport.interface, transport.channel, transport.bitrate, transport.nodes, timeout_s)
        self._setpoints = setpoints_of(transport)
        self._drives = [DriveFeedback(counts) for counts in transport.counts_at_zero]
        by_node = dict(zip(transport.nodes, self._drives, strict=True))
        self._power = DrivesPower(by_node, transport.period_ms, self.link.emergency_of, report)
        self._discrete = DISCRETE_CALIBRATED if transport.absolute else 0
        self._known: set[int] = set()  # nodes that have said that they are drives
        self._count = 0

    def connect(self) -> BoardFacts:
        """Find every drive, choose its mode, and let it operate.

        Raises:
            LinkTimeout: one does not answer. RemoteProtocolError: one is no drive, or does not have the mode.
        """
        self.link.open()
        self._let_go(self._known)
        self._identify()
        for node in self._transport.nodes:
            self._choose_mode(node)
            self.link.start(node)
        self._switch_off()
        return BoardFacts("F", len(self._drives), references=self._setpoints.mode == CYCLIC_POSITION)

    def exchange(self, operations: Operations, image: Words) -> None:
        """See `Bus`. Of several writes to one converter in a list the last one reaches the drive."""
        for kind, offset, value in operations.tolist():
            self._setpoints.take(kind, offset, value)
            if kind == OP_WRITE:
                self._write(offset, value)
        sampled_ns = self._ask_all()
        self._judge_power()
        self._fill(image, sampled_ns)

    def close(self) -> None:
        """Let go of the interface; the drives notice by their own time-out."""
        self.link.close()

    # ------------------------------------------------------------------------------------------------------ inside

    def _ask_all(self) -> int:
        """Exchange with every drive; when they sampled, ns. Where one fails the others are let go.

        That is at SYNC: an answer that is read late, because this process was held up meanwhile, tells of then.
        """
        try:
            self.link.drain()  # what a drive has told unasked, or too late, is older than what it is asked for now
            self._transmit()
            sampled_ns = self._now_ns()
            self.link.send(SYNC, b"")
            self._collect()
        except (LinkError, ProtocolError):
            self._let_go(self._known)
            raise
        return self._now_ns() if self._virtual_time else sampled_ns

    def _identify(self) -> None:
        """See that every node is a drive; each that is known only now is let go at once, for another may be silent."""
        strangers = []
        for node, kind in self.link.upload_from_each(self._transport.nodes, DEVICE_TYPE, 0):
            if kind is None or kind & 0xFFFF != PROFILE:
                strangers.append(node)
                self._known.discard(node)
            elif node not in self._known:
                self._known.add(node)
                self._let_go((node,))
        if strangers:
            raise RemoteProtocolError(f"node {min(strangers)} is no drive of CiA 402")

    def _let_go(self, nodes: Collection[int]) -> None:
        """Take the torque of those drives that still hear, until power is asked for anew; what fails is passed over.

        `nodes` are known to be drives: a module would switch its outputs by it. In position mode, those that have not
        told yet where they are get no target.
        """
        self._power.tripped, told = True, False
        for channel, (node, drive) in enumerate(zip(self._transport.nodes, self._drives, strict=True)):
            if node not in nodes or (self._setpoints.mode == CYCLIC_POSITION and not drive.status):
                continue
            setpoint, told = self._setpoints.value(channel, drive, False), True
            with suppress(LinkError):
                self.link.send(RPDO[0] + node, self._setpoints.frame.pack(self._setpoints.leaving, setpoint))
        if told:
            with suppress(LinkError):
                self.link.send(SYNC, b"")

    def _write(self, offset: int, value: int) -> None:
        if offset == DISCRETE:
            if not value & DISCRETE_POWER:
                self._power.forget()
                self._setpoints.forget()
            self._discrete = value
        elif ENC_LOAD <= offset < ENC_LOAD + 2 * len(self._drives) and self._may_load:
            channel = (offset - ENC_LOAD) // 2
            self._drives[channel].loaded = value - self._turned(channel)

    @property
    def _may_load(self) -> bool:
        """False under a position loop: a counter that jumps would be a jump of the arm."""
        in_operation = any(drive.state is DriveState.ENABLED for drive in self._drives)
        return self._setpoints.mode != CYCLIC_POSITION or not in_operation

    def _transmit(self) -> None:
        wanted = self._wants_power
        driven = wanted and self._power.on
        self._setpoints.begin(driven)
        for channel, (node, drive) in enumerate(zip(self._transport.nodes, self._drives, strict=True)):
            setpoint = self._setpoints.value(channel, drive, driven)
            self.link.send(RPDO[0] + node, self._setpoints.frame.pack(self._control(node, wanted), setpoint))

    @property
    def _wants_power(self) -> bool:
        return bool(self._discrete & DISCRETE_POWER) and not self._power.tripped

    def _control(self, node: int, wanted: bool) -> int:
        if self._setpoints.silent:
            return QUICK_STOP  # goes on until power is taken away: the drives need their time
        return self._power.lead(node) if wanted else DISABLE_VOLTAGE

    def _collect(self) -> None:
        waiting = {TPDO[0] + node: channel for channel, node in enumerate(self._transport.nodes)}
        deadline = Deadline(self.link.timeout_s)
        while waiting:
            message = self.link.receive(deadline, f"node {min(waiting) - TPDO[0]}")
            channel = waiting.pop(message.arbitration_id, None)
            if channel is None:
                continue
            if len(message.data) < FROM_DRIVE.size:
                raise RemoteProtocolError(
                    f"TPDO 1 of node {self._transport.nodes[channel]} is too short: check its mapping"
                )
            self._drives[channel].hear(*FROM_DRIVE.unpack_from(bytes(message.data)))

    def _judge_power(self) -> None:
        if self._wants_power and self._setpoints.silent:
            self._power.trip("no reference has come any more")
        elif self._wants_power:
            self._power.judge()

    def _choose_mode(self, node: int) -> None:
        mode = self._setpoints.mode
        self.link.download(node, MODE_WANTED, 0, mode, 1)
        if self.link.upload(node, MODE_SHOWN, 0) & 0xFF != mode:
            raise RemoteProtocolError(f"the drive of node {node} has no {self._setpoints.mode_name} mode")

    def _switch_off(self) -> None:
        self._discrete &= SCRATCH_BITS if self._transport.absolute else SCRATCH_BITS & ~DISCRETE_CALIBRATED
        self._power.forget()
        self._setpoints = setpoints_of(self._transport)
        for drive in self._drives:
            drive.status = 0
        self.link.drain()

    def _turned(self, channel: int) -> int:
        return round(self._drives[channel].position / self._transport.increments_per_count[channel])

    def _fill(self, image: Words, t_ns: int) -> None:
        self._count += 1
        image[IMAGE_T_NS], image[IMAGE_COUNT] = t_ns, self._count
        stopped = any(drive.state is DriveState.QUICK_STOPPED for drive in self._drives)
        image[IMAGE_INPUTS:] = 0
        image[IMAGE_STATUS] = (
            STATUS_INDEX
            | STATUS_ADC_BUSY
            | self._discrete & SCRATCH_BITS
            | STATUS_POWER * (self._power.on and not self._power.tripped)
            | STATUS_ESTOP_OK * (not stopped)
        )
        for channel, drive in enumerate(self._drives):
            word = self._turned(channel) + drive.loaded
            image[IMAGE_ENC_COUNT + channel] = word & 0xFFFF


def drives_bus(transport: DrivesTransport, patience_ms: float, report: Report) -> DrivesBus:
    """The bus that a deployment file describes. Raises ConfigError when python-can is not installed."""
    load_can()
    return DrivesBus(transport, patience_ms=patience_ms, report=report)
