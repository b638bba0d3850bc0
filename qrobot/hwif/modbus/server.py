"""Modbus TCP server for a board, in a thread of its own.

Modbus has no authentication: who may connect is told by where they come from. On this machine that is the server's own
account and root, as the kernel tells; from elsewhere the addresses that were named, and nobody else (`door`).
Connections, how many are accepted at a time, the bytes that wait for each, and how long it may be silent are bounded.

pymodbus decodes, checks and encodes the requests; `ModbusDevice` knows what they mean. Frames are cut here: a
connection that sends something other than Modbus is closed and counted, and requests sent without waiting for the
answers are answered one after the other.
"""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Iterator, Sequence
from contextlib import suppress
from contextvars import ContextVar
from itertools import islice
from types import TracebackType
from typing import Any, Final, NamedTuple

from pymodbus.constants import ExcCodes
from pymodbus.pdu import ExceptionResponse, ModbusPDU
from pymodbus.server import ModbusTcpServer
from pymodbus.server.requesthandler import ServerRequestHandler
from pymodbus.simulator import DataType, SimData, SimDevice

from qrobot.errors import ConfigError, LinkBusy, LinkError, RemoteProtocolError
from qrobot.hwif.bus import NO_OPERATIONS, Endpoint
from qrobot.hwif.modbus.device import WATCHDOG_MS, ModbusDevice
from qrobot.hwif.modbus.door import Allowed, BoardDoor, networks
from qrobot.hwif.modbus.map import BOARD_ROWS, ROBOT_ROWS, WORD_BITS, MapRow
from qrobot.report import Report
from qrobot.units import NS_PER_S

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
MAX_CALLERS: Final = 32  # connections; of more, one that has never asked for anything is closed, or the most silent [A]
SILENCE_NS: Final = 300 * NS_PER_S  # a connection without a request for so long is closed [A]
REQUESTS_IN_A_ROW: Final = 16  # of one connection, before others have their turn
UNREAD_BYTES: Final = 4_096  # requests that may wait; more stay with the client
UNSENT_BYTES: Final = 16_384  # answers that may wait for a client that does not read

_client: ContextVar[object] = ContextVar("modbus_client")


class ModbusServer:
    """Serves `device` from `__enter__` to `__exit__`.

    Args:
        device: the board.
        host: address to listen at.
        port: 0 takes a free one, see `address`.
        allowed: addresses or networks of other machines that may connect.

    Raises:
        ConfigError: the address is open to other machines and none is allowed.
        LinkBusy: the address is taken, or is not this machine's.
    """

    def __init__(
        self, device: ModbusDevice, host: str = "127.0.0.1", port: int = 0, allowed: Sequence[str] = ()
    ) -> None:
        self.device = device
        self._allowed = networks(host, allowed)
        self.address = host, port
        self.callers: dict[Caller, int] = {}  # connections, and when they last asked for something
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
            server = self._loop.run_until_complete(_listen(self.device, self.address, self._allowed))
            if server is not None:
                self.address = self.address[0], server.port
                self._listens = True
                self._serve(server)
        finally:
            self._tried.set()
            self._loop.close()

    def _serve(self, server: ModbusBoardServer) -> None:
        self.callers = server.callers
        watch = self._loop.create_task(_watch(server))
        self._tried.set()
        self._loop.run_forever()
        watch.cancel()
        self._loop.run_until_complete(_close(server, watch))


class ServerAddress(NamedTuple):
    """Address to serve at, silence in milliseconds after which the board is made safe, and clients from elsewhere."""

    host: str
    port: int
    watchdog_ms: float
    allowed: tuple[str, ...]


def split_address(address: str) -> ServerAddress:
    """An address out of `HOST:PORT`, `HOST:PORT@MS` or `HOST:PORT@MS+CLIENT,...`. Raises ConfigError."""
    place, _, clients = address.partition("+")
    where, _, patience = place.partition("@")
    host, _, port = where.rpartition(":")
    if host.startswith("[") and host.endswith("]"):  # as an address of IPv6 stands before a port (RFC 3986, 3.2.2)
        host = host[1:-1]
    if not host or not port.isdecimal() or int(port) > LAST_PORT or (patience and not patience.isdecimal()):
        raise ConfigError(f"Modbus address {address!r}: give HOST:PORT or HOST:PORT@MS, for instance 127.0.0.1:1502")
    return ServerAddress(host, int(port), float(patience or WATCHDOG_MS), tuple(filter(None, clients.split(","))))


def check_address(address: str) -> ServerAddress:
    """The same, where a server may be. Raises ConfigError also for clients that are none, or when all could come."""
    found = split_address(address)
    networks(found.host, found.allowed)
    return found


def modbus_server(address: str, endpoint: Endpoint, report: Report) -> ModbusServer:
    """A server for a board that runs by itself, to be entered, at an address of the command line.

    Raises:
        ConfigError: the address is none.
    """
    host, port, watchdog_ms, allowed = split_address(address)
    endpoint.apply(NO_OPERATIONS)  # compiles here, not while the first client waits
    return ModbusServer(ModbusDevice(endpoint, watchdog_ms, report=report), host, port, allowed)


async def _listen(device: ModbusDevice, address: tuple[str, int], allowed: Allowed) -> ModbusBoardServer | None:
    server = ModbusBoardServer(device, address, allowed)
    return server if await server.listen() else None


async def _watch(server: ModbusBoardServer) -> None:
    while True:
        server.device.watch()
        server.dismiss_silent(server.device.now_ns() - SILENCE_NS)
        await asyncio.sleep(WATCH_S)


async def _close(server: ModbusTcpServer, watch: asyncio.Task[None]) -> None:
    await asyncio.gather(watch, return_exceptions=True)
    await server.shutdown()
    await asyncio.sleep(0)  # the connections see that they are closed


class ModbusBoardServer(ModbusTcpServer):
    """Listens; each connection is a `Caller`.

    Attributes:
        callers: the connections, the one that has been silent for longest first.
    """

    def __init__(self, device: ModbusDevice, address: tuple[str, int], allowed: Allowed) -> None:
        super().__init__(_sim_device(device), address=address)
        self.device = device
        self.callers: dict[Caller, int] = {}  # when they last asked for something
        self._place, self._allowed = address, allowed
        self.call_create = self._open_door  # what pymodbus listens by, in the place of asyncio's own server

    @property
    def port(self) -> int:
        """The port it listens at."""
        door: Any = self.transport
        return int(door.address[1])

    async def _open_door(self) -> BoardDoor:
        return BoardDoor(*self._place, self._allowed, self.handle_new_connection)

    def heard(self, caller: Caller) -> None:
        """A connection begins, or asks for something: it is the last to be closed when there are too many."""
        self.callers.pop(caller, None)
        if len(self.callers) >= MAX_CALLERS:
            self.dismiss(next((each for each in self.callers if not each.has_asked), next(iter(self.callers))))
        self.callers[caller] = self.device.now_ns()

    def dismiss_silent(self, before_ns: int) -> None:
        """Close connections that have asked for nothing since `before_ns` of the device's clock."""
        while self.callers and next(iter(self.callers.values())) < before_ns:
            self.dismiss(next(iter(self.callers)))

    def dismiss(self, caller: Caller) -> None:
        """Close a connection; the arm it may have had under control is made safe."""
        self.callers.pop(caller, None)
        caller.cut()
        self.device.leave(caller)

    def callback_new_connection(self) -> ServerRequestHandler:
        """Somebody connects."""
        return Caller(self, self.device)


class Caller(ServerRequestHandler):
    """One connection.

    Attributes:
        has_asked: it has made a request.
    """

    def __init__(self, owner: ModbusBoardServer, device: ModbusDevice) -> None:
        super().__init__(owner, None, None, None)  # type: ignore[no-untyped-call]
        self._owner = owner
        self._device = device
        self._received = bytearray()
        self.has_asked = False
        self._unread = False  # the client does not read its answers

    def callback_connected(self) -> None:
        """Bound what waits for this client."""
        super().callback_connected()
        transport: Any = self.transport
        connection = transport.get_extra_info("socket")
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, UNSENT_BYTES)
        transport.set_write_buffer_limits(high=UNSENT_BYTES, low=0)
        self._owner.heard(self)

    @property
    def waiting_bytes(self) -> int:
        """Bytes held for this client: requests to be answered, and answers it has not read."""
        transport: Any = self.transport
        return len(self._received) + (transport.get_write_buffer_size() if transport is not None else 0)

    def cut(self) -> None:
        """Close the connection without waiting for the client to read."""
        transport: Any = self.transport
        if transport is not None:
            transport.abort()

    def data_received(self, data: bytes) -> None:
        """Answer every whole request; close the connection at the first bytes that are no Modbus."""
        if self in self._owner.callers:
            self._received += data
            self._work()

    def pause_writing(self) -> None:
        """The client does not read its answers: it gets no more."""
        self._unread = True

    def resume_writing(self) -> None:
        """Go on writing: the client reads again."""
        self._unread = False
        self._work()

    def _work(self) -> None:
        """Answer some requests, and come back for the rest; what is too much stays with the client meanwhile."""
        if self._unread or self not in self._owner.callers:
            self._hold_back(True)
            return
        try:
            heard = [*islice(frames(self._received), REQUESTS_IN_A_ROW)]
        except RemoteProtocolError:
            self._device.bad += 1
            self._owner.dismiss(self)
            return
        for transaction, unit, request in heard:
            self.has_asked = True
            self._owner.heard(self)
            self._device.hear(self)
            self.loop.create_task(self._answer(transaction, unit, request))
        self._hold_back(len(self._received) > UNREAD_BYTES)
        if len(heard) == REQUESTS_IN_A_ROW:
            self.loop.call_soon(self._work)

    def _hold_back(self, much: bool) -> None:
        transport: Any = self.transport
        if transport is None or transport.is_closing():
            return
        if much:
            transport.pause_reading()
        else:
            transport.resume_reading()

    def callback_disconnected(self, exc: Exception | None) -> None:  # noqa: ARG002 (pymodbus names it so)
        """The connection is gone."""
        self._owner.callers.pop(self, None)
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


def _sim_data(row: MapRow, readonly: bool) -> SimData:
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
