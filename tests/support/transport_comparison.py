"""The transports to a board side by side: the same servo, the same arm and the same virtual time over each of them."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from qrobot.config import Robot
from qrobot.hwif.board_memory import BoardMemory, attach_board_memory, create_board_memory
from qrobot.hwif.bus import NO_OPERATIONS, Bus, Endpoint
from qrobot.hwif.isa.card import serve_card, show_card
from qrobot.modecodes import Mode
from qrobot.rig.lockstep import LockstepRig, run_blocks
from qrobot.servo.memory.telemetry import Rows
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator, emulator_run
from tests.support.fake_card import FakeCard
from tests.support.stepping_endpoint import SteppingEndpoint
from tests.support.transport_rig import TransportRig

COMPARED: Final = ("q_ref", "dac", "q", "mode")
PATIENCE_S: Final = 60.0  # on the wall clock: a busy machine must not look like a cut


class MemoryRig(LockstepRig):
    """Servo and board meet in shared memory, each with a mapping of its own, as two processes have.

    Attributes:
        board_runs: False stops the board's side, as a process that hangs or was killed.
    """

    def __init__(
        self, robot: Robot, settings: ServoSettings, emulator: Emulator, near: BoardMemory, far: BoardMemory
    ) -> None:
        super().__init__(robot, settings, emulator, board=near)
        self._far = far
        self.board_runs = True

    def ticks(self, n: int) -> None:
        """Advance by `n` servo cycles; a board that does not run costs no virtual time of the arm."""
        for _ in range(n):
            run_blocks(*self.loop_arguments, self.now_ns, 1, 0)
            if self.board_runs:
                emulator_run(self.emulator.bundle, self._far, self.now_ns, self.substeps)
            self.now_ns += self.period_ns
            self.keep()


class CardRig(LockstepRig):
    """The servo's loop around an ISA card, as `servo.process.loop.run` has it, with a fake one that the emulator
    answers.

    Attributes:
        card: the fake card, to be pulled out of its slot and looked at.
    """

    def __init__(self, robot: Robot, settings: ServoSettings, emulator: Emulator) -> None:
        super().__init__(robot, settings, emulator)
        self.end = SteppingEndpoint(emulator, self.substeps, self.now_ns)
        self.card = FakeCard(self.end)

    def ticks(self, n: int) -> None:
        """Advance by `n` servo cycles; a card that is pulled costs no virtual time of the arm."""
        for _ in range(n):
            show_card(self.card.words, self.board, self.now_ns)
            run_blocks(*self.loop_arguments, self.now_ns, 1, 0)
            serve_card(self.card.words, self.board, self.now_ns)
            self.card.settle()
            self.now_ns += self.period_ns
            self.keep()


@contextmanager
def _direct(robot: Robot, settings: ServoSettings, emulator: Emulator) -> Iterator[LockstepRig]:
    yield LockstepRig(robot, settings, emulator)


@contextmanager
def _memory(robot: Robot, settings: ServoSettings, emulator: Emulator) -> Iterator[LockstepRig]:
    name = f"transport{os.getpid()}"
    with create_board_memory(name) as far, attach_board_memory(name) as near:
        yield MemoryRig(robot, settings, emulator, near.memory, far.memory)


@contextmanager
def _card(robot: Robot, settings: ServoSettings, emulator: Emulator) -> Iterator[LockstepRig]:
    yield CardRig(robot, settings, emulator)


@contextmanager
def _bus(
    open_bus: Callable[[Endpoint, ExitStack], Bus], robot: Robot, settings: ServoSettings, emulator: Emulator
) -> Iterator[LockstepRig]:
    with ExitStack() as stack:
        yield TransportRig(robot, settings, lambda end: open_bus(end, stack), emulator)


def _standing_clock() -> int:
    """Far ends of a transport in lock-step have nobody to be impatient with."""
    return 0


def _open_modbus(end: Endpoint, stack: ExitStack) -> Bus:
    from qrobot.hwif.modbus.client import ModbusBus, ModbusLine
    from qrobot.hwif.modbus.device import ModbusDevice
    from qrobot.hwif.modbus.server import ModbusServer

    end.apply(NO_OPERATIONS)  # compiles here, not while the near end waits for an answer
    server = stack.enter_context(ModbusServer(ModbusDevice(end, watchdog_ms=0.0, now_ns=_standing_clock)))
    bus = ModbusBus(ModbusLine(*server.address, timeout_s=PATIENCE_S))
    stack.callback(bus.close)
    return bus


def _open_can(end: Endpoint, stack: ExitStack) -> Bus:
    from qrobot.hwif.canbus.client import CanBus
    from qrobot.hwif.canbus.interface import open_interface
    from qrobot.hwif.canbus.server import can_server

    channel = f"transport{os.getpid()}"
    end.apply(NO_OPERATIONS)
    with open_interface("virtual", channel) as listener:
        stack.enter_context(
            can_server(f"virtual:{channel}", end, lambda _line: None, watchdog_ms=0.0, now_ns=_standing_clock)
        )
        listener.recv(PATIENCE_S)  # its boot-up message: one that came later would look like a node that started anew
    bus = CanBus("virtual", channel, timeout_s=PATIENCE_S)
    stack.callback(bus.close)
    return bus


TRANSPORTS: Final[dict[str, Callable[[Robot, ServoSettings, Emulator], AbstractContextManager[LockstepRig]]]] = {
    "direct": _direct,
    "shared memory": _memory,
    "ISA card": _card,
    "Modbus TCP": partial(_bus, _open_modbus),
    "CAN": partial(_bus, _open_can),
}
"""A servo and an emulated board in lock-step, by the transport between them: both in one array, in shared memory with a
mapping each, behind a card that is not there, behind a Modbus server and behind a CAN node of this process."""


@dataclass(frozen=True, eq=False)
class TransportRun:
    """What came of a motion over one transport.

    Attributes:
        error: largest absolute tracking error of each joint, rad or m. Shape (n,).
        digest: of setpoint, torque word, position and mode of every cycle.
        fault: code of the first fault, 0 for none.
    """

    transport: str
    rate_hz: float
    error: NDArray[np.float64]
    digest: str
    fault: int


def run_over(
    transport: str, robot: Robot, settings: ServoSettings, emulator: Emulator, move: Callable[[LockstepRig], object]
) -> TransportRun:
    """Let `move` move the arm over one of `TRANSPORTS`. Raises KeyError for another transport, LinkError when it is not
    there."""
    with TRANSPORTS[transport](robot, settings, emulator) as rig:
        move(rig)
        rows = rig.rows()
    tracked = rows[rows["mode"] == Mode.TRACKING]
    error = np.abs(tracked["q_ref"] - tracked["q"]).max(axis=0)
    faults = rows["fault"][rows["fault"] != 0]
    return TransportRun(transport, settings.rate_hz, error, _digest(rows), int(faults[0]) if faults.size else 0)


def _digest(rows: Rows) -> str:
    digest = hashlib.sha256()
    for field in COMPARED:
        digest.update(np.ascontiguousarray(rows[field]).tobytes())
    return digest.hexdigest()
