"""The transports by name: the bus a deployment file describes, and the servers a command line asks for."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from typing import TYPE_CHECKING, Final, NamedTuple

from qrobot.config.deployment import BoardChoice
from qrobot.errors import ConfigError
from qrobot.hwif.board_memory import BoardMemory
from qrobot.hwif.bus import Bus, Endpoint
from qrobot.hwif.modbus.library import require_pymodbus
from qrobot.report import Report
from qrobot.units import NS_PER_MS

if TYPE_CHECKING:
    from qrobot.hwif.canbus.sensor import SensorBus
    from qrobot.hwif.modbus.io import RemoteModule


class Transport(NamedTuple):
    """The near end of a transport.

    Attributes:
        bus: not connected yet.
        period_ns: time between two exchanges.
        module_losses: how often remote modules, or the interface of a sensor, beside the board have been lost.
        settle: waits, once the bus is closed, until remote modules have been let go of.
    """

    bus: Bus
    period_ns: int
    module_losses: Callable[[], int]
    settle: Callable[[], None]


def open_transport(
    board: BoardChoice,
    report: Report = lambda _line: None,
    patience_ms: float = math.inf,
    begin: Callable[[], object] = lambda: None,
) -> Transport:
    """The transport to `board`, with whatever stands beside it.

    `report` takes a line when a module or a sensor beside the board is found or lost, and when a separate drive is the
    reason that arm power goes or does not come. Separate drives are not left alone with their last torque for longer
    than `patience_ms`, the servo's with its board. `begin` is called first in each thread of a module or a sensor,
    to give it the priority of the one that exchanges.

    Raises:
        ConfigError: this board is not reached by a gateway, or what the transport is made of is not installed.
    """
    bus = _bus_of(board, report, patience_ms)
    modules = _modules(board, report, begin)
    beside: list[RemoteModule | SensorBus] = [*modules]
    if board.can_sensor is not None:
        from qrobot.hwif.canbus.sensor import with_sensor

        bus = sensor = with_sensor(bus, board.can_sensor, report, begin)
        beside.append(sensor)
    settle = _nothing
    if modules:
        from qrobot.hwif.modbus.io import IoBus

        bus = with_modules = IoBus(bus, modules)
        settle = with_modules.settle
    return Transport(bus, round(board.period_ms * NS_PER_MS), lambda: sum(each.losses for each in beside), settle)


def _nothing() -> None:
    """Wait for nothing."""


def _modules(board: BoardChoice, report: Report, begin: Callable[[], object] = lambda: None) -> list[RemoteModule]:
    """The remote modules beside a board. Raises ConfigError when pymodbus is not installed and there are some."""
    if not board.io:
        return []
    require_pymodbus()
    from qrobot.hwif.modbus.io import RemoteModule

    return [RemoteModule(module, report, begin=begin) for module in board.io]


def modules_beside(board: BoardChoice, memory: BoardMemory, report: Report) -> AbstractContextManager[object]:
    """The remote modules of an emulated board work its panel while the block runs. Raises ConfigError as above."""
    modules = _modules(board, report)
    if not modules:
        return nullcontext()
    from qrobot.hwif.modbus.panel import panel_modules

    return panel_modules(memory, modules)


def _bus_of(board: BoardChoice, report: Report, patience_ms: float) -> Bus:
    if board.kind == "port":
        raise ConfigError("the servo reaches a card on this machine's bus by itself: no board process is needed")
    if board.can is not None:
        from qrobot.hwif.canbus.client import can_bus

        return can_bus(board.can)
    if board.modbus is not None:
        require_pymodbus()
        from qrobot.hwif.modbus.client import modbus_bus

        return modbus_bus(board.modbus)
    if board.drives is not None:
        from qrobot.hwif.canbus.drives import drives_bus

        return drives_bus(board.drives, patience_ms, report)
    raise ConfigError(f"a board of kind {board.kind!r} is behind no transport")


def _serve_can(address: str, endpoint: Endpoint, report: Report) -> AbstractContextManager[object]:
    from qrobot.hwif.canbus.interface import load_can

    load_can()  # says what to install
    from qrobot.hwif.canbus.server import can_server

    return can_server(address, endpoint, report)


def _serve_modbus(address: str, endpoint: Endpoint, report: Report) -> AbstractContextManager[object]:
    require_pymodbus()
    from qrobot.hwif.modbus.server import modbus_server

    return modbus_server(address, endpoint, report)


def _check_can(address: str) -> None:
    from qrobot.hwif.canbus.interface import load_can

    load_can()
    from qrobot.hwif.canbus.server import split_address

    split_address(address)


def _check_modbus(address: str) -> None:
    require_pymodbus()
    from qrobot.hwif.modbus.server import check_address

    check_address(address)


CHECKS: Final[dict[str, Callable[[str], None]]] = {"can": _check_can, "modbus": _check_modbus}
SERVERS: Final[dict[str, Callable[[str, Endpoint, Report], AbstractContextManager[object]]]] = {
    "can": _serve_can,
    "modbus": _serve_modbus,
}


def _transport_and_address(text: str) -> tuple[str, str]:
    kind, _, address = text.partition("=")
    if kind not in SERVERS or not address:
        raise ConfigError(f"--serve {text!r}: give TRANSPORT=ADDRESS, with a transport out of {', '.join(SERVERS)}")
    return kind, address


def check_servers(wanted: tuple[str, ...]) -> None:
    """Raise ConfigError where `servers` would, while nothing has begun."""
    for kind, address in map(_transport_and_address, wanted):
        CHECKS[kind](address)


@contextmanager
def servers(wanted: tuple[str, ...], endpoint: Endpoint, report: Report) -> Iterator[None]:
    """Serve a board over transports given as `can=INTERFACE:CHANNEL`, `modbus=HOST:PORT` while the block runs.

    Raises:
        ConfigError: no such transport, or an address it cannot have. LinkError: the address is in use, or not there.
    """
    with ExitStack() as stack:
        for kind, address in map(_transport_and_address, wanted):
            stack.enter_context(SERVERS[kind](address, endpoint, report))
        yield
