"""The common part of near ends on CAN: whose frames are listened to."""

from __future__ import annotations

import uuid
from collections.abc import Iterator

import can
import pytest

from qrobot.hwif.canbus.frames import EMCY, HEARTBEAT, TPDO
from qrobot.hwif.canbus.link import CanLink
from qrobot.realtime.deadline import Deadline
from tests.support.patience import PATIENCE_S

NODE = 5
OVERCURRENT = (0x2310).to_bytes(2, "little")


class Desk:
    """A link, and somebody who sends frames to it."""

    def __init__(self) -> None:
        channel = uuid.uuid4().hex
        self.far = can.Bus(interface="virtual", channel=channel)
        self.link = CanLink("virtual", channel, 1_000_000, (NODE,))
        self.link.open()

    def send(self, can_id: int, data: bytes, extended: bool) -> None:
        self.far.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=extended))

    def receive(self) -> bytes:
        return bytes(self.link.receive(Deadline(PATIENCE_S), "somebody").data)


@pytest.fixture
def desk() -> Iterator[Desk]:
    desk = Desk()
    yield desk
    desk.link.close()
    desk.far.shutdown()


@pytest.mark.parametrize("can_id", [TPDO[0] + NODE, 0x18FF0000 + TPDO[0] + NODE])
def test_a_frame_of_29_bits_is_no_answer_whatever_its_number(desk: Desk, can_id: int) -> None:
    desk.send(can_id, b"other", extended=True)
    desk.send(TPDO[0] + NODE, b"own", extended=False)
    assert desk.receive() == b"own"


@pytest.mark.parametrize(("base", "data"), [(EMCY, OVERCURRENT), (HEARTBEAT, b"\0")])
def test_nor_is_it_a_complaint_or_a_new_start_of_a_node(desk: Desk, base: int, data: bytes) -> None:
    desk.send(base + NODE, data, extended=True)
    desk.send(TPDO[0] + NODE, b"own", extended=False)
    desk.link.drain()
    desk.send(TPDO[0] + NODE, b"own", extended=False)
    assert desk.receive() == b"own"
    assert desk.link.emergencies == ""
    desk.send(EMCY + NODE, OVERCURRENT, extended=False)
    desk.link.drain()
    assert desk.link.emergency_of(NODE) == 0x2310
