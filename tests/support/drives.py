"""Six emulated drives of CiA 402 on python-can's `virtual` interface, and the bus to them."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import can
import numpy as np
import pytest

from qrobot.config import Robot
from qrobot.config.drives import DrivesTransport
from qrobot.errors import LinkTimeout
from qrobot.hwif.bus import NO_OPERATIONS, Endpoint
from qrobot.hwif.canbus.drives import DrivesBus
from qrobot.hwif.image import IMAGE_ENC_COUNT, IMAGE_STATUS, make_image
from tests.support.bus import Row, rows_of
from tests.support.can_transport import end_of_cut, ends_cut
from tests.support.drive_loop import PositionLoop
from tests.support.emulated_drives import EmulatedDrives
from tests.support.patience import MOMENT_S, PATIENCE_S, wait_until

NODES = (1, 2, 3, 4, 5, 6)
TORQUE = (2048.0, -2048.0, 2048.0, 1024.0, -1024.0, 2048.0)
INCREMENTS = (4.0, -16.0, 4.0, 131.072, 4.0, -4.0)
FULL = 2048.0  # thousandths of the rated torque that stand for one count of a converter each
DAC_SHARE = 0.97  # of the converter: what the arm's amplifiers are good for


def torque_for(robot: Robot) -> tuple[float, ...]:
    """`torque_permille` with which drives turn their own motors the right way round, in the emulated arm."""
    transmission = robot.transmission
    signs = np.sign(transmission.dac_per_Nm * transmission.rad_per_count * np.array(INCREMENTS))
    return tuple((-FULL * signs).tolist())


def loops_for(robot: Robot, period_s: float) -> list[PositionLoop]:
    """Position loops of the drives for SYNC every `period_s`, twice as stiff as the robot file's gains."""
    transmission = robot.transmission
    per_increment = np.abs(transmission.dac_per_Nm * transmission.rad_per_count / np.array(INCREMENTS))
    gain, damping = 2.0 * robot.control.kp * per_increment, 2.0**0.5 * robot.control.kv * per_increment / period_s
    return [PositionLoop(*each, limit=DAC_SHARE * FULL) for each in zip(gain, damping, strict=True)]


class Drives:
    """Emulated drives in a thread, and the bus to them: in position mode when they are given loops of their own.

    Attributes:
        far: the drives. transport, bus: to them. silent: node numbers of which nothing is heard. image: the last one.
        lines: what the bus has reported.
    """

    def __init__(self, end: Endpoint, absolute: bool, torque: Sequence[float], loops: Sequence[PositionLoop]) -> None:
        channel = uuid.uuid4().hex
        self.interface = can.Bus(interface="virtual", channel=channel)
        self.far = EmulatedDrives(end, self._send, NODES, torque, INCREMENTS, loops)
        self.transport = DrivesTransport(
            interface="virtual",
            channel=channel,
            mode="position" if loops else "torque",
            nodes=NODES,
            torque_permille=() if loops else tuple(torque),
            increments_per_count=INCREMENTS,
            counts_at_zero=(0,) * 6,
            absolute=absolute,
        )
        self.lines: list[str] = []
        self.bus = DrivesBus(self.transport, lambda: getattr(end, "now_ns", 1), report=self.lines.append)
        self.bus.link.timeout_s = PATIENCE_S
        self.silent: set[int] = set()
        self._cut = False
        self.image = make_image()

    def _send(self, can_id: int, data: bytes) -> None:
        if can_id & 0x7F not in self.silent:
            self.interface.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    def serve(self, stop: threading.Event) -> None:
        """Be the drives until `stop` is set."""
        while not stop.is_set():
            if (message := self.interface.recv(0.01)) is None:
                continue
            if ends_cut(message):
                self._cut = False
            elif not self._cut:
                self.far.take(message.arbitration_id, bytes(message.data))

    def hurry(self) -> None:
        """Wait a moment only, for what will not come."""
        self.bus.link.timeout_s = MOMENT_S

    def complaint(self) -> str:
        """What the bus says that gets no answer; the next time it waits longer, for drives may have had no turn."""
        with pytest.raises(LinkTimeout) as complaint:
            self.exchange()
        self.bus.link.timeout_s *= 2.0
        return str(complaint.value)

    def cut(self) -> None:
        """Let nothing through the wire."""
        self.hurry()
        self._cut = True

    def mend(self) -> None:
        """Let everything through again, and nothing that was sent before."""
        self.bus.link.timeout_s = PATIENCE_S
        end_of_cut(self.transport.channel)
        wait_until(lambda: not self._cut, "what was sent before has passed")

    def exchange(self, *rows: Row, times: int = 1) -> int:
        """Exchange; the STATUS word of the last image."""
        for _ in range(times):
            self.bus.exchange(rows_of(rows), self.image)
        return int(self.image[IMAGE_STATUS])

    def counts(self) -> list[int]:
        """What the counters show."""
        return [int(word) for word in self.image[IMAGE_ENC_COUNT:][:6]]


@contextmanager
def served(
    end: Endpoint, absolute: bool = True, torque: Sequence[float] = TORQUE, loops: Sequence[PositionLoop] = ()
) -> Iterator[Drives]:
    """Drives whose thread runs while the block does."""
    end.apply(NO_OPERATIONS)  # compile before somebody waits
    drives, stop = Drives(end, absolute, torque, loops), threading.Event()
    thread = threading.Thread(target=drives.serve, args=(stop,), daemon=True)
    thread.start()
    try:
        yield drives
    finally:
        stop.set()
        thread.join()
        drives.bus.close()
        drives.interface.shutdown()
