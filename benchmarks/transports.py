"""Whole images a second on each transport to a board, far end in another process, against a bare loop of its
library."""

from __future__ import annotations

import asyncio
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.rows import Row, against, row
from benchmarks.timing import Effort
from qrobot.arrays import Words
from qrobot.hwif.board_memory import LANE_CAPACITY, N_LANES, local_board_memory, publish_image
from qrobot.hwif.bus import BoardFacts, MemoryEndpoint, Operations, safe_operations
from qrobot.hwif.image import make_image
from qrobot.hwif.lanes import take_all_operations
from qrobot.hwif.operations import OP_FIELDS

EXCHANGES: Final = 20_000
WARM_UP: Final = 100
BARE, OURS = "bare", "ours"
BARE_REGISTERS: Final = 32


class Desk:
    """An endpoint that takes what comes and shows an image, as a board does whose time costs nothing."""

    def __init__(self) -> None:
        self._memory = local_board_memory()
        self._memory.facts.revision, self._memory.facts.joints = ord("F"), 6
        self._end = MemoryEndpoint(self._memory)
        self._taken = np.zeros((N_LANES * LANE_CAPACITY, OP_FIELDS), np.int64)
        self._lanes = np.zeros(len(self._taken), np.int64)
        self._image = make_image()

    def facts(self) -> BoardFacts:
        return self._end.facts()

    def apply(self, operations: Operations) -> None:
        self._end.apply(operations)
        take_all_operations(self._memory, self._taken, self._lanes)
        self._image[:2] += 1
        publish_image(self._memory, self._image)

    def read_image(self, image: Words) -> None:
        self._end.read_image(image)


def rows(effort: Effort) -> Iterator[Row]:
    """The rows."""
    times = effort.times(EXCHANGES)
    desk, operations, image = Desk(), safe_operations(0), make_image()

    def through_memory() -> None:
        desk.apply(operations)
        desk.read_image(image)

    yield row("image through shared memory, from Python", 1 / np.median(durations(through_memory, times)), "images/s")
    yield from transport_rows("Modbus", "bare pymodbus", modbus_durations(effort, times))
    yield from transport_rows("CAN by UDP multicast", "bare python-can", can_durations(effort, times))


def transport_rows(transport: str, peer: str, both: tuple[NDArray[np.float64], NDArray[np.float64]]) -> Iterator[Row]:
    """The rows of one transport, from the durations of our exchange and of the bare one."""
    ours, bare = both
    yield against(f"image over {transport}", 1 / np.median(ours), "images/s", peer, float(1 / np.median(bare)))
    for percent in (50, 99):
        value, reference = (float(np.percentile(each, percent)) * 1e6 for each in both)
        yield against(f"image over {transport}, p{percent}", value, "µs", peer, reference)


def durations(exchange: Callable[[], object], times: int) -> NDArray[np.float64]:
    """How long each exchange takes, s. Shape (times,)."""
    for _ in range(WARM_UP):
        exchange()
    stamps = np.empty(times + 1)
    stamps[0] = perf_counter()
    for i in range(times):
        exchange()
        stamps[i + 1] = perf_counter()
    return np.diff(stamps)


def modbus_durations(effort: Effort, times: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Of our exchange and of the bare one, in turns."""
    ours, bare = [], []
    with (
        far_end(OURS) as our_port,
        far_end(BARE) as bare_port,
        our_bus(our_port) as bus,
        bare_client(bare_port) as client,
    ):
        for _ in range(effort.rounds):
            ours.append(durations(bus, times // effort.rounds + 1))
            bare.append(durations(client, times // effort.rounds + 1))
    return np.concatenate(ours), np.concatenate(bare)


def can_durations(effort: Effort, times: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Of our exchange and of as many frames by python-can alone, in turns."""
    from benchmarks.can_transport import bare_frames, our_can

    ours, bare = [], []
    with our_can() as bus, bare_frames() as frames:
        for _ in range(effort.rounds):
            ours.append(durations(bus, times // effort.rounds + 1))
            bare.append(durations(frames, times // effort.rounds + 1))
    return np.concatenate(ours), np.concatenate(bare)


@contextmanager
def bare_client(port: int) -> Iterator[Callable[[], object]]:
    """pymodbus alone: as many registers as an image has, read and written in one request."""
    from pymodbus.client import ModbusTcpClient

    client, values = ModbusTcpClient("127.0.0.1", port=port), [0] * BARE_REGISTERS
    client.connect()
    yield lambda: client.readwrite_registers(
        read_address=0, read_count=BARE_REGISTERS, write_address=0, values=values, device_id=1
    )
    client.close()


@contextmanager
def our_bus(port: int) -> Iterator[Callable[[], object]]:
    """What a gateway does each cycle."""
    from qrobot.hwif.modbus.client import ModbusBus, ModbusLine

    bus, operations, image = ModbusBus(ModbusLine("127.0.0.1", port, timeout_s=60.0)), safe_operations(0), make_image()
    bus.connect()
    yield lambda: bus.exchange(operations, image)
    bus.close()


@contextmanager
def far_end(kind: str) -> Iterator[int]:
    """A server in a process of its own, on the port given."""
    command = [sys.executable, "-m", "benchmarks.transports", kind]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield int(process.stdout.readline())
        finally:
            process.terminate()


def serve_ours() -> None:
    """A board of ours, until the end of the process."""
    from qrobot.hwif.modbus.device import ModbusDevice
    from qrobot.hwif.modbus.server import ModbusServer

    desk = Desk()
    desk.apply(safe_operations(0))
    with ModbusServer(ModbusDevice(desk, watchdog_ms=0)) as server:
        print(server.address[1], flush=True)
        sys.stdin.read()


async def serve_bare() -> None:
    """A server of pymodbus with as many registers as an image has."""
    from pymodbus.server import ModbusTcpServer
    from pymodbus.simulator import DataType, SimData, SimDevice

    block = SimData(0, values=[0] * BARE_REGISTERS, datatype=DataType.REGISTERS)
    server = ModbusTcpServer(SimDevice(id=1, simdata=[block]), address=("127.0.0.1", 0))
    await server.listen()
    print(server.transport.sockets[0].getsockname()[1], flush=True)
    await server.serving


if __name__ == "__main__":
    if sys.argv[1] == BARE:
        asyncio.run(serve_bare())
    else:
        serve_ours()
