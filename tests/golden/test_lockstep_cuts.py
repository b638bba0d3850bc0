"""Every transport cut in the middle of a fast move: a stop within the bound, a clear word, and no restart of
anything."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.faultcodes import FaultCode
from qrobot.hwif.board_memory import attach_board_memory, create_board_memory
from qrobot.hwif.bus import Endpoint
from qrobot.hwif.canbus.drives import DrivesBus
from qrobot.hwif.registers import DAC_ZERO
from qrobot.modecodes import Mode
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.can_transport import TransportStack
from tests.support.drive_loop import PositionLoop
from tests.support.drives import Drives, loops_for, served, torque_for
from tests.support.modbus_transport import Far
from tests.support.thorough import wide
from tests.support.transport_comparison import CardRig, MemoryRig
from tests.support.transport_rig import TransportRig

ROBOT = load_robot("puma560")
SETTINGS = ServoSettings(rate_hz=500.0)
FRAME_NS, FRAMES = 28_000_000, 8
PUSH = np.array([0.002, 0.002, -0.002, 0.001, 0.001, 0.002])  # rad a frame, more in every frame
FAST_RAD_S = 0.4
BOUND = 4 + 1  # cycles: four without a new image are not held against the board (docs/reference/faults.md, BOARD_GONE)


@dataclass
class Transport:
    """A rig whose transport can be cut and mended; `told` is what its gateway says of the cut, where there is one."""

    rig: LockstepRig
    cut: Callable[[], object]
    mend: Callable[[], object]
    until_far_end_is_safe: Callable[[], object] = lambda: None
    told: str = ""


def new_emulator() -> Emulator:
    return Emulator(ROBOT, physics="rigid")


@contextmanager
def memory() -> Iterator[Transport]:
    name = f"cut{os.getpid()}"
    with create_board_memory(name) as far, attach_board_memory(name) as near:
        rig = MemoryRig(ROBOT, SETTINGS, new_emulator(), near.memory, far.memory)
        yield Transport(rig, lambda: setattr(rig, "board_runs", False), lambda: setattr(rig, "board_runs", True))


@contextmanager
def card() -> Iterator[Transport]:
    rig = CardRig(ROBOT, SETTINGS, new_emulator())
    yield Transport(rig, lambda: setattr(rig.card, "pulled", True), lambda: setattr(rig.card, "pulled", False))


@contextmanager
def modbus() -> Iterator[Transport]:
    with ExitStack() as stack:
        far = Far(stack)
        rig = TransportRig(ROBOT, SETTINGS, far.open_bus, new_emulator())
        yield Transport(rig, far.cut, far.mend, far.until_safe, "gave no answer")


@contextmanager
def can() -> Iterator[Transport]:
    with TransportStack() as transports:
        rig = TransportRig(ROBOT, SETTINGS, transports.open, new_emulator())
        transport = transports.transport

        def cut() -> None:
            transport.hurry()
            transport.cut()

        yield Transport(rig, cut, transport.restore, transport.expire, "does not answer")


@contextmanager
def drives(settings: ServoSettings, loops: Sequence[PositionLoop]) -> Iterator[Transport]:
    with ExitStack() as stack:
        opened: list[Drives] = []

        def open_bus(end: Endpoint) -> DrivesBus:
            opened.append(stack.enter_context(served(end, torque=torque_for(ROBOT), loops=loops)))
            return opened[0].bus

        rig = TransportRig(ROBOT, settings, open_bus, new_emulator())
        far = opened[0]
        yield Transport(
            rig,
            far.cut,
            far.mend,
            far.far.lose_sync,  # their own time-out, which virtual time cannot bring about
            "does not answer",
        )


def torque_drives() -> AbstractContextManager[Transport]:
    return drives(SETTINGS, ())


def position_drives() -> AbstractContextManager[Transport]:
    settings = dataclasses.replace(SETTINGS, position_drives=True)
    return drives(settings, loops_for(ROBOT, settings.period_ns * 1e-9))


def power_on(rig: LockstepRig) -> None:
    rig.ticks(3)
    rig.mailbox.request_power(True)
    rig.run_for(0.3)
    assert rig.mailbox.snapshot().mode == Mode.HOLDING


def get_going(rig: LockstepRig) -> None:
    q = ROBOT.poses["park"].copy()
    for frame in range(FRAMES):
        q += PUSH * frame
        rig.mailbox.push_setpoint(1, frame, rig.now_ns, FRAME_NS, [POSITION_SETPOINT] * ROBOT.n, q.tolist())
        rig.run_for(FRAME_NS * 1e-9)
    assert np.abs(rig.emulator.v).max() > FAST_RAD_S


@pytest.mark.parametrize("open_transport", [memory, card, *wide(modbus, can, torque_drives), position_drives])
def test_a_transport_cut_in_a_fast_move_stops_the_arm_in_time_and_a_mended_one_needs_no_restart(
    open_transport: Callable[[], AbstractContextManager[Transport]],
) -> None:
    with open_transport() as transport:
        rig = transport.rig
        power_on(rig)
        get_going(rig)
        before = len(rig.rows())
        transport.cut()
        rig.ticks(2 * BOUND)
        after = rig.rows()[before:]
        reaction = int(np.argmax(after["mode"] == Mode.FAULT))
        assert 0 < reaction <= BOUND
        assert after["fault"][reaction] == FaultCode.BOARD_GONE
        assert (after["dac"][reaction:] == DAC_ZERO).all()
        if isinstance(rig, TransportRig):
            assert transport.told in rig.lines[-1]
        transport.until_far_end_is_safe()
        transport.mend()
        rig.run_for(0.5)
        assert not rig.emulator.powered
        assert rig.emulator.bundle.board.dac[: ROBOT.n].tolist() == [DAC_ZERO] * ROBOT.n
        assert rig.mailbox.snapshot().mode == Mode.FAULT
        rig.mailbox.request_power(False)
        rig.mailbox.request_clear()
        rig.run_for(0.3)
        power_on(rig)
        assert rig.emulator.powered
