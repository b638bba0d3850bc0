"""Every road cut in the middle of a fast move: a stop within the bound, a clear word, and no restart of anything."""

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
from qrobot.hwif.bus import Endpoint
from qrobot.hwif.canbus.drives import DrivesBus
from qrobot.hwif.memory import attach_board_memory, create_board_memory
from qrobot.hwif.registers import DAC_ZERO
from qrobot.rig.crossing import CardRig, MemoryRig
from qrobot.rig.lockstep import LockstepRig
from qrobot.rig.lockstep_road import RoadRig
from qrobot.servo.modes import Mode
from qrobot.servo.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.drive_loop import PositionLoop
from qrobot.sim_board.emulator import Emulator
from tests.support.can_road import RoadStack
from tests.support.drives import Drives, loops_for, served, torque_for
from tests.support.modbus_road import Far

ROBOT = load_robot("puma560")
SETTINGS = ServoSettings(rate_hz=500.0)
FRAME_NS, FRAMES = 28_000_000, 8
PUSH = np.array([0.002, 0.002, -0.002, 0.001, 0.001, 0.002])  # rad a frame, more in every frame
FAST_RAD_S = 0.4
BOUND = 4 + 1  # cycles: four without a new image are not held against the board (docs/reference/faults.md, BOARD_GONE)


@dataclass
class Road:
    """A rig whose road can be cut and mended; `told` is what its gateway says of the cut, where there is one."""

    rig: LockstepRig
    cut: Callable[[], object]
    mend: Callable[[], object]
    until_far_end_is_safe: Callable[[], object] = lambda: None
    told: str = ""


def new_emulator() -> Emulator:
    return Emulator(ROBOT, physics="rigid")


@contextmanager
def memory() -> Iterator[Road]:
    name = f"cut{os.getpid()}"
    with create_board_memory(name) as far, attach_board_memory(name) as near:
        rig = MemoryRig(ROBOT, SETTINGS, new_emulator(), near.words, far.words)
        yield Road(rig, lambda: setattr(rig, "board_runs", False), lambda: setattr(rig, "board_runs", True))


@contextmanager
def card() -> Iterator[Road]:
    rig = CardRig(ROBOT, SETTINGS, new_emulator())
    yield Road(rig, lambda: setattr(rig.card, "pulled", True), lambda: setattr(rig.card, "pulled", False))


@contextmanager
def modbus() -> Iterator[Road]:
    with ExitStack() as stack:
        far = Far(stack)
        rig = RoadRig(ROBOT, SETTINGS, far.open_bus, new_emulator())
        yield Road(rig, far.cut, far.mend, far.until_safe, "gave no answer")


@contextmanager
def can() -> Iterator[Road]:
    with RoadStack() as roads:
        rig = RoadRig(ROBOT, SETTINGS, roads.open, new_emulator())
        road = roads.road

        def cut() -> None:
            road.hurry()
            road.cut()

        yield Road(rig, cut, road.restore, road.expire, "does not answer")


@contextmanager
def drives(settings: ServoSettings, loops: Sequence[PositionLoop]) -> Iterator[Road]:
    with ExitStack() as stack:
        opened: list[Drives] = []

        def open_bus(end: Endpoint) -> DrivesBus:
            opened.append(stack.enter_context(served(end, torque=torque_for(ROBOT), loops=loops)))
            return opened[0].bus

        rig = RoadRig(ROBOT, settings, open_bus, new_emulator())
        far = opened[0]
        yield Road(
            rig,
            far.cut,
            far.mend,
            far.far.lose_sync,  # their own time-out, which virtual time cannot bring about
            "does not answer",
        )


def torque_drives() -> AbstractContextManager[Road]:
    return drives(SETTINGS, ())


def position_drives() -> AbstractContextManager[Road]:
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


@pytest.mark.parametrize("open_road", [memory, card, modbus, can, torque_drives, position_drives])
def test_a_road_cut_in_a_fast_move_stops_the_arm_in_time_and_a_mended_one_needs_no_restart(
    open_road: Callable[[], AbstractContextManager[Road]],
) -> None:
    with open_road() as road:
        rig = road.rig
        power_on(rig)
        get_going(rig)
        before = len(rig.rows())
        road.cut()
        rig.ticks(2 * BOUND)
        after = rig.rows()[before:]
        reaction = int(np.argmax(after["mode"] == Mode.FAULT))
        assert 0 < reaction <= BOUND
        assert after["fault"][reaction] == FaultCode.BOARD_GONE
        assert (after["dac"][reaction:] == DAC_ZERO).all()
        if isinstance(rig, RoadRig):
            assert road.told in rig.lines[-1]
        road.until_far_end_is_safe()
        road.mend()
        rig.run_for(0.5)
        assert not rig.emulator.powered
        assert rig.emulator.bundle.board.dac[: ROBOT.n].tolist() == [DAC_ZERO] * ROBOT.n
        assert rig.mailbox.snapshot().mode == Mode.FAULT
        rig.mailbox.request_power(False)
        rig.mailbox.request_clear()
        rig.run_for(0.3)
        power_on(rig)
        assert rig.emulator.powered
