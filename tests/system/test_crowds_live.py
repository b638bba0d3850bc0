"""Crowds at the door of the bridge of an arm that moves: they do not stop it.

Judged by what the servo wrote down in each cycle from before the crowd came until the program had ended. Before
connections were accepted a few at a time, this crowd stopped the arm four to eight times in ten seconds.
"""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pytest

from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.rccl_bridge.settings import BridgeSettings
from qrobot.rci import TcpLink
from qrobot.wire import ClientRole, Hello
from tests.support.flood import flood
from tests.support.patience import PATIENCE_S
from tests.support.processes import UNHURRIED_MS, RunningArm

pytestmark = pytest.mark.realtime

FAST = 0.3  # rad/s
AT_REST = 1e-6  # rad/s; a program that ends leaves its stream by a stop at rest
LEGS = 4
SETTINGS = BridgeSettings()
PROGRAM = f"""
from qrobot import rccl

with rccl.control("puma560", period_ms={UNHURRIED_MS}) as arm:
    arm.setjvel(1.05)
    for leg in range({LEGS}):
        arm.move(arm.pose("park" if leg % 2 else "end"))
    arm.waitfor(arm.completed)
"""


@pytest.fixture
def program(tmp_path: Path) -> Path:
    """A program that goes back and forth and ends."""
    path = tmp_path / "legs.py"
    path.write_text(PROGRAM)
    return path


@contextmanager
def full_house(address: tuple[str, int]) -> Iterator[None]:
    """Inside, every place that the commander leaves is taken: by observers, and by clients that never greet."""
    with ExitStack() as crowd:
        for number in range(SETTINGS.max_clients - 1):
            observer = TcpLink(Hello(ClientRole.OBSERVER, "", f"observer {number}", period_us=10_000), address)
            crowd.callback(observer.close)
            observer.open()
        for _ in range(SETTINGS.max_greeting):
            crowd.enter_context(socket.create_connection(address, PATIENCE_S))
        yield


def test_a_crowd_at_full_speed_in_every_place_does_not_stop_an_arm_that_moves(arm: RunningArm, program: Path) -> None:
    address = (arm.arm.bridge.host, arm.arm.bridge.port)
    with arm.moving(program, FAST) as process:
        began_ns = arm.now_ns()
        with full_house(address), flood(address):
            assert process.wait(PATIENCE_S) == 0, process.communicate()
    arm.wait_for(Mode.HOLDING)
    rows = arm.telemetry()
    rows = rows[rows["t_ns"] >= began_ns]
    moving = np.abs(rows["v_ref"]).max(axis=1) > AT_REST
    assert moving.any()
    assert set(rows["fault"].tolist()) == {FaultCode.NONE}  # the newest event of each cycle, so also what was over soon
    assert set(rows["mode"][moving].tolist()) == {Mode.TRACKING}
