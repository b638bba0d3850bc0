"""Modbus TCP server for a board, in a thread of its own.

pymodbus decodes, checks and encodes the requests; `ModbusDevice` knows what they mean. Frames are cut here: a
connection that sends something other than Modbus is closed and counted, and requests sent without waiting for the
answers are answered one after the other.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator, Sequence
from contextlib import suppress
from contextvars import ContextVar
from types import TracebackType
from typing import Any, Final

from pymodbus.constants import ExcCodes
from pymodbus.pdu import ExceptionResponse, ModbusPDU
from pymodbus.server import ModbusTcpServer
from pymodbus.server.requesthandler import ServerRequestHandler
from pymodbus.simulator import DataType, SimData, SimDevice

from qrobot.errors import ConfigError, LinkBusy, LinkError, RemoteProtocolError
from qrobot.hwif.bus import NO_OPERATIONS, Endpoint
from qrobot.hwif.modbus.device import WATCHDOG_MS, ModbusDevice, Report
from qrobot.hwif.modbus.map import BOARD_ROWS, ROBOT_ROWS, WORD_BITS, Row

MBAP_BYTES: Final = (
    7  # transaction, protocol, length of what follows it, unit (Modbus messaging on TCP/IP V1.0b, 3.1.3)
)
MAX_LENGTH: Final = 254
LAST_PORT: Final = 65535
FUNCTIONS: Final = frozenset({1, 2, 3, 4, 5, 6, 15, 16, 22, 23})
READ_COILS, READ_DISCRETE_INPUTS = 1, 2
COILS: Final = (READ_COILS, 5, 15)
START_PATIENCE_S: Final = 30.0
WATCH_S: Final = 0.005

_client: ContextVar[object] = ContextVar("modbus_client")


class ModbusServer:
    """Serves `device` from `__enter__` to `__exit__`.

    Args:
        device: the board.
        host: address to listen at; anything but loopback lets the whole network move the arm.
        port: 0 takes a free one, see `address`.

    Raises:
        LinkBusy: the address is taken, or is not this machine's.
    """

    def __init__(self, device: ModbusDevice, host: str = "127.0.0.1", port: int = 0) -> None:
        self.device = device
        self.address = host, port
        self._loop = asyncio.new_event_loop()
        self._listens = False
        self._tried = threading.Event()
        self._thread = threading.Thread(target=self._run, name="modbus-server", daemon=True)

    def __enter__(self) -> ModbusServer:
        with suppress(LinkError):  # clients will be told
            self.device.warm_up()
        self._thread.start()
        self._tried.wait(START_PATIENCE_S)
        if not self._listens:
            host, port = self.address
            raise LinkBusy(f"cannot listen at {host}:{port}: is the port taken, or the address another machine's?")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()

    def _run(self) -> None:
        try:
            server = self._loop.run_until_complete(_listen(self.device, self.address))
            if server is not None:
                listener: Any = server.transport
                self.address = self.address[0], listener.sockets[0].getsockname()[1]
                self._listens = True
                self._serve(server)
        finally:
            self._tried.set()
            self._loop.close()

    def _serve(self, server: ModbusTcpServer) -> None:
        watch = self._loop.create_task(_watch(self.device))
        self._tried.set()
        self._loop.run_forever()
        watch.cancel()
        self._loop.run_until_complete(_close(server, watch))


def split_address(address: str) -> tuple[str, int, float]:
    """Host, port and milliseconds of the watchdog of `HOST:PORT` or `HOST:PORT@MS`. Raises ConfigError."""
    where, _, patience = address.partition("@")
    host, _, port = where.rpartition(":")
    if not host or not port.isdecimal() or int(port) > LAST_PORT or (patience and not patience.isdecimal()):
        raise ConfigError(f"Modbus address {address!r}: give HOST:PORT or HOST:PORT@MS, for instance 127.0.0.1:1502")
    return host, int(port), float(patience or WATCHDOG_MS)


def modbus_server(address: str, endpoint: Endpoint, report: Report) -> ModbusServer:
    """A server for a board that runs by itself, to be entered, at an address of the command line.

    Raises:
        ConfigError: the address is none.
    """
    host, port, watchdog_ms = split_address(address)
    endpoint.apply(NO_OPERATIONS)  # compiles here, not while the first client waits
    return ModbusServer(ModbusDevice(endpoint, watchdog_ms, report=report), host, port)


async def _listen(device: ModbusDevice, address: tuple[str, int]) -> ModbusTcpServer | None:
    server = BoardServer(device, address)
    return server if await server.listen() else None


async def _watch(device: ModbusDevice) -> None:
    while True:
        device.watch()
        await asyncio.sleep(WATCH_S)


async def _close(server: ModbusTcpServer, watch: asyncio.Task[None]) -> None:
    await asyncio.gather(watch, return_exceptions=True)
    await server.shutdown()
    await asyncio.sleep(0)  # the connections see that they are closed


class BoardServer(ModbusTcpServer):
    """Listens; each connection is a `Caller`."""

    def __init__(self, device: ModbusDevice, address: tuple[str, int]) -> None:
        super().__init__(_sim_device(device), address=address)
        self.device = device

    def callback_new_connection(self) -> ServerRequestHandler:
        """Somebody connects."""
        return Caller(self, self.device)


class Caller(ServerRequestHandler):
    """One connection."""

    def __init__(self, owner: BoardServer, device: ModbusDevice) -> None:
        super().__init__(owner, None, None, None)  # type: ignore[no-untyped-call]
        self._device = device
        self._received = bytearray()

    def data_received(self, data: bytes) -> None:
        """Answer every whole request; close the connection at the first bytes that are no Modbus."""
        self._received += data
        try:
            for transaction, unit, request in frames(self._received):
                self._device.hear(self)
                self.loop.create_task(self._answer(transaction, unit, request))
        except RemoteProtocolError:
            self._device.bad += 1
            self.close()
            self._device.leave(self)

    def callback_disconnected(self, exc: Exception | None) -> None:  # noqa: ARG002 (pymodbus names it so)
        """The connection is gone."""
        self._device.leave(self)

    async def _answer(self, transaction: int, unit: int, request: bytes) -> None:
        """Never suspends, so requests are answered in the order they came."""
        function = request[0]
        pdu = self.framer.decoder.decode(request) if function in FUNCTIONS else None
        if pdu is None:
            self._device.bad += 1
            code = ExcCodes.ILLEGAL_VALUE if function in FUNCTIONS else ExcCodes.ILLEGAL_FUNCTION
            refusal = ExceptionResponse(function & 0x7F, code, unit, transaction)
            self.server_send(refusal, None)  # type: ignore[no-untyped-call]
            return
        pdu.dev_id, pdu.transaction_id = unit, transaction
        await self._carry_out(pdu)

    async def _carry_out(self, pdu: ModbusPDU) -> None:
        self.last_pdu, self.last_addr = pdu, None
        _client.set(self)
        await self.handle_request()  # type: ignore[no-untyped-call]


def frames(buffer: bytearray) -> Iterator[tuple[int, int, bytes]]:
    """Cut whole requests off the front of `buffer`: transaction, unit, function and data.

    Raises:
        RemoteProtocolError: what comes is not Modbus.
    """
    while len(buffer) >= MBAP_BYTES:
        transaction, protocol, length = (int.from_bytes(buffer[i : i + 2], "big") for i in (0, 2, 4))
        if protocol or not 2 <= length <= MAX_LENGTH:
            raise RemoteProtocolError(f"protocol {protocol}, length {length}: that is no Modbus frame")
        end = MBAP_BYTES - 1 + length
        if len(buffer) < end:
            return
        unit, request = buffer[MBAP_BYTES - 1], bytes(buffer[MBAP_BYTES:end])
        del buffer[:end]
        yield transaction, unit, request


def _sim_device(device: ModbusDevice) -> SimDevice:
    """The map as pymodbus wants it; unit 0 stands for every unit, for nothing is behind this server but one board."""
    rows = BOARD_ROWS + (ROBOT_ROWS if device.has_robot else ())
    bits = [False] * WORD_BITS

    async def act(
        function: int, start: int, address: int, count: int, registers: list[int], values: Sequence[Any] | None
    ) -> ExcCodes | None:
        try:
            _access(device, function, start, address, count, registers, values)
        except LinkBusy:
            return ExcCodes.DEVICE_BUSY
        except LinkError:
            return ExcCodes.DEVICE_FAILURE
        except RemoteProtocolError:
            device.bad += 1
            return ExcCodes.ILLEGAL_VALUE
        return None

    return SimDevice(
        id=0,
        simdata=(
            [SimData(0, values=bits, datatype=DataType.BITS)],
            [SimData(0, values=bits, datatype=DataType.BITS)],
            [_sim_data(row, row.access == "read") for row in rows],
            [_sim_data(row, True) for row in rows],
        ),
        action=act,
    )


def _sim_data(row: Row, readonly: bool) -> SimData:
    return SimData(row.address, values=[0] * row.count, datatype=DataType.REGISTERS, readonly=readonly)


def _access(
    device: ModbusDevice,
    function: int,
    start: int,
    address: int,
    count: int,
    registers: list[int],
    values: Sequence[Any] | None,
) -> None:
    """One access: `registers`, which begin at `start`, are brought up to date, or `values` are written to the board."""
    client = _client.get()
    if function == READ_DISCRETE_INPUTS:
        registers[0] = device.discrete_inputs()
    elif function in COILS and values is None:
        registers[0] = device.coils()
    elif function in COILS:
        device.write_coils(client, address, values or ())
    elif values is not None:
        device.write(client, address, values)
    else:
        for first, words in device.read(client, address, count).items():
            registers[first - start : first - start + len(words)] = words
