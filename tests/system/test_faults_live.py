"""Faults in a board process while a program moves the arm: what the other processes make of it, on the wall clock."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from qrobot.errors import LinkError, LogError
from qrobot.faultcodes import FaultCode
from qrobot.hwif.board_memory import attach_board_memory
from qrobot.hwif.registers import DAC, DAC_ZERO, DISCRETE, DISCRETE_POWER, N_DACS
from qrobot.log.flight import incidents_of
from qrobot.log.read import read_log
from qrobot.modecodes import Mode
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.servo_memory import attach_servo_memory
from qrobot.sim_board.injection import FaultPanel, Injected
from tests.support.patience import PATIENCE_S, STALL_MS, wait_until
from tests.support.processes import RunningArm, qrobot, write_deployment

pytestmark = pytest.mark.realtime

SOON_NS = round(STALL_MS * 1e6)  # a tick or two, and what a busy machine adds
FAST = 0.8  # rad/s
PROGRAM = """
from qrobot import rccl

arm = rccl.control("puma560", period_ms=100, clear_fault=True)
arm.setjvel(1.05)
while True:
    for name in ("park", "end"):
        arm.move(arm.pose(name))
        arm.waitfor(arm.completed)
"""


@pytest.fixture
def program(tmp_path: Path) -> Path:
    """A program that goes back and forth for ever."""
    path = tmp_path / "legs.py"
    path.write_text(PROGRAM)
    return path


def inject(arm: RunningArm, line: str) -> int:
    """Inject a fault into the running board; the time just before."""
    with attach_board_memory(arm.name) as segment:
        panel = FaultPanel(segment.memory)
        panel.clear()
        t_ns = arm.now_ns()
        panel.add(line)
    return t_ns


def repair(arm: RunningArm) -> Injected:
    """Repair everything; what became of the fault injected last."""
    with attach_board_memory(arm.name) as segment:
        panel = FaultPanel(segment.memory)
        report = panel.reports()[-1]
        panel.clear()
    return report


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("power drop", FaultCode.POWER_LOST),
        ("estop pressed", FaultCode.ESTOP),
        ("board off", FaultCode.BOARD_GONE),
    ],
)
def test_a_fault_on_the_way_takes_torque_and_power_and_a_clear_brings_neither_back(
    arm: RunningArm, program: Path, line: str, code: FaultCode
) -> None:
    known = _recordings(arm, code)
    with arm.moving(program, FAST):
        injected_ns = inject(arm, line)
        arm.wait_for(Mode.FAULT)
        safe_ns = _torque_gone_ns(arm, injected_ns)
    assert FaultCode(arm.snapshot().fault) is code
    assert 0 <= safe_ns - injected_ns < SOON_NS
    assert repair(arm).acted > 0
    wait_until(lambda: not arm.powered, "power off")
    wait_until(lambda: _saved(arm, code, known), "the flight recorder's file")
    before = np.array(arm.encoders())
    with attach_servo_memory(arm.name) as segment:
        ServoMailbox(segment.words).request_power(False)
        ServoMailbox(segment.words).request_clear()
    arm.wait_for(Mode.OFF)
    assert not arm.powered
    assert np.abs(np.array(arm.encoders())[:3] - before[:3]).max() <= 2
    with arm.swinging(FAST) as channel:
        assert arm.mode is Mode.TRACKING
        channel.stop()


def _recordings(arm: RunningArm, code: FaultCode) -> set[Path]:
    """Files of the flight recorder about a fault."""
    return set((arm.deployment.parent / "log" / "incidents").glob(f"{arm.name}-{code.name}-*.mcap"))


def _saved(arm: RunningArm, code: FaultCode, known: set[Path]) -> bool:
    """The flight recorder has written a whole file about a new fault `code`, with what happened in it."""
    for path in _recordings(arm, code) - known:
        with suppress(LogError):  # it has just been begun
            log = read_log(path)
            if log.torn:
                return False
            [incident] = incidents_of(log)
            assert log.rows["t_ns"][0] < incident.t_ns < log.rows["t_ns"][-1]
            return incident.code == code
    return False


def _torque_gone_ns(arm: RunningArm, since_ns: int) -> int:
    """When, after a time, all DACs had been set to zero torque and power was off, by the board's clock."""
    held, power = dict.fromkeys(range(DAC, DAC + 2 * N_DACS, 2), -1), True
    for t_ns, _lane, offset, value in arm.trace().tolist():
        if offset == DISCRETE:
            power = bool(value & DISCRETE_POWER)
        else:
            held[offset] = value
        if t_ns > since_ns and not power and set(held.values()) == {DAC_ZERO}:
            return int(t_ns)
    raise AssertionError("torque or power was never taken away")


def test_the_command_injects_into_a_running_board_and_shows_whether_it_acted(arm: RunningArm) -> None:
    shown = qrobot("inject", "estop pressed +50ms", "--clear", "--deployment", arm.deployment, "--arm", arm.name)
    assert shown.communicate(timeout=PATIENCE_S)[0].count("estop pressed") == 1
    wait_until(lambda: _over(arm), "the end of the fault")
    assert repair(arm).acted > 0


def _over(arm: RunningArm) -> bool:
    with attach_board_memory(arm.name) as segment:
        return FaultPanel(segment.memory).report(0).over


def test_a_board_is_broken_from_its_start_when_asked(tmp_path: Path) -> None:
    deployment = write_deployment(tmp_path)
    board = qrobot("board", deployment, "--fault", "estop pressed")
    try:
        name = deployment.read_text().split('name = "')[1].split('"')[0]
        wait_until(lambda: _acted(name), "a fault that acts")
    finally:
        board.terminate()
        board.communicate(timeout=PATIENCE_S)


def _acted(name: str) -> bool:
    try:
        with attach_board_memory(name) as segment:
            return FaultPanel(segment.memory).report(0).acted > 0
    except (KeyError, LinkError):
        return False
