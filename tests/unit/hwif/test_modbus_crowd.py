"""A crowd at the Modbus server: what it costs the event loop that answers the controller and runs the watchdog."""

from __future__ import annotations

import asyncio
import socket
from contextlib import ExitStack

import pytest

from qrobot.hwif.modbus.device import ModbusDevice
from qrobot.hwif.modbus.door import BoardDoor
from qrobot.hwif.modbus.server import ModbusBoardServer, ModbusServer
from qrobot.hwif.registers import DAC
from qrobot.realtime.acceptor import BURST
from tests.support.flood import flood
from tests.support.paper_board import PaperBoard
from tests.support.patience import PATIENCE_S
from tests.support.virtual_clock import VirtualClock

CROWD = 60
WRITE = bytes([0, 1, 0, 0, 0, 6, 1, 6, 0, DAC // 2, 8, 0])


def test_between_two_turns_of_the_watchdog_few_connections_are_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    taken, per_turn = [], []
    admits = BoardDoor.admits

    def counted(door: BoardDoor, connection: socket.socket) -> bool:
        taken.append(connection)
        return admits(door, connection)

    async def take_all() -> None:
        server = ModbusBoardServer(ModbusDevice(PaperBoard(), now_ns=VirtualClock()), ("127.0.0.1", 0), ())
        assert await server.listen()
        with ExitStack() as crowd:
            for _ in range(CROWD):
                crowd.enter_context(socket.create_connection(("127.0.0.1", server.port)))
            while len(taken) < CROWD:
                before = len(taken)
                await asyncio.sleep(0)
                per_turn.append(len(taken) - before)
        await server.shutdown()  # type: ignore[no-untyped-call]
        await asyncio.sleep(0)  # the connections see that they are closed

    monkeypatch.setattr(BoardDoor, "admits", counted)
    asyncio.run(asyncio.wait_for(take_all(), PATIENCE_S))
    assert max(per_turn) == BURST


def test_a_server_that_ends_while_somebody_enters_leaves_no_connection_open(monkeypatch: pytest.MonkeyPatch) -> None:
    async def end_at_the_door() -> bytes:
        server = ModbusBoardServer(ModbusDevice(PaperBoard(), now_ns=VirtualClock()), ("127.0.0.1", 0), ())
        assert await server.listen()
        entered = asyncio.Event()

        def admit(*_: object) -> bool:
            entered.set()
            return True

        monkeypatch.setattr(BoardDoor, "admits", admit)
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        await entered.wait()
        await server.shutdown()  # type: ignore[no-untyped-call]
        found = await reader.read()
        writer.close()
        return found

    assert asyncio.run(asyncio.wait_for(end_at_the_door(), PATIENCE_S)) == b""


@pytest.mark.thorough
@pytest.mark.realtime
def test_connections_opened_at_full_speed_do_not_keep_the_server_from_its_controller() -> None:
    device = ModbusDevice(PaperBoard())
    with ModbusServer(device) as served, socket.create_connection(served.address, timeout=PATIENCE_S) as controller:
        with flood(served.address):
            for _ in range(200):
                controller.sendall(WRITE)
                assert controller.recv(300) == WRITE
        assert device.trips == 0
