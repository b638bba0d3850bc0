"""`qrobot calibrate` against a real servo, board and guardian."""

from __future__ import annotations

import json
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from qrobot.config.deployment import load_deployment
from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.rig.deployed import ArmProcesses
from qrobot.rig.processes import ProcessRig
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.published_state import FLAG_CALIBRATED, ServoSnapshot
from qrobot.servo.memory.servo_memory import attach_servo_memory
from qrobot.servo.operator.client import ServoClient
from tests.support.patience import PATIENCE_S, wait_until
from tests.support.processes import left_behind, qrobot, shared_starter, write_deployment
from tests.support.signals import default_signals

pytestmark = pytest.mark.realtime

CALIBRATION_S = 4.0 * PATIENCE_S


@pytest.fixture
def processes(tmp_path: Path) -> Iterator[ArmProcesses]:
    """Board (not calibrated), servo and guardian of a fresh arm whose deployment names the table."""
    path = write_deployment(tmp_path, board='calibration_table = "puma560"')
    arm = load_deployment(path).arm[0]
    with ProcessRig(tmp_path / "processes", shared_starter()) as rig:
        processes = ArmProcesses(rig, str(path), arm)
        rig.start(processes.board("--uncalibrated"), processes.servo(), processes.guardian())
        yield processes
    assert left_behind(arm.name) == []


def test_an_arm_just_switched_on_is_calibrated_and_a_new_servo_adopts_that(processes: ArmProcesses) -> None:
    arm = processes.arm.name
    command = qrobot("calibrate", processes.deployment, "--arm", arm, "--indexes", "3", "--json")
    said, complaints = command.communicate(timeout=CALIBRATION_S)
    assert command.returncode == 0, complaints
    assert json.loads(said)["votes"] == [3] * 6
    assert flags(arm) & FLAG_CALIBRATED
    processes.end("servo")
    processes.start("servo")
    wait_until(lambda: flags(arm) & FLAG_CALIBRATED, "the new servo adopts the counters")
    again = qrobot("calibrate", processes.deployment, "--arm", arm)
    said, _ = again.communicate(timeout=CALIBRATION_S)
    assert again.returncode == 0
    assert "calibrated already" in said


def test_a_calibration_whose_terminal_is_closed_or_that_is_ended_stops_and_gives_power_back(
    processes: ArmProcesses,
) -> None:
    arm = processes.arm.name
    for number in (signal.SIGHUP, signal.SIGTERM):
        with default_signals(number):
            command = qrobot("calibrate", processes.deployment, "--arm", arm)
        wait_until(lambda: snapshot(arm).mode == Mode.CALIBRATING, "the arm creeps")
        command.send_signal(number)
        command.communicate(timeout=CALIBRATION_S)
        wait_until(lambda: snapshot(arm).mode == Mode.OFF, f"power is off after {number.name}")
        assert snapshot(arm).event == FaultCode.CAL_STOPPED


def test_a_calibration_that_nobody_follows_any_more_is_stopped(processes: ArmProcesses) -> None:
    """Not one that `qrobot ctl calibrate` has begun, which nobody follows by its nature."""
    arm = processes.arm.name
    command = qrobot("calibrate", processes.deployment, "--arm", arm)
    wait_until(lambda: snapshot(arm).mode == Mode.CALIBRATING, "the arm creeps")
    command.kill()
    command.communicate()
    wait_until(lambda: snapshot(arm).mode != Mode.CALIBRATING, "the arm is stopped")
    assert (snapshot(arm).mode, snapshot(arm).event) == (Mode.UNCALIBRATED, FaultCode.CAL_STOPPED)
    with ServoClient(arm) as servo:
        servo.calibrate()
    before = snapshot(arm).tick
    wait_until(lambda: snapshot(arm).tick > before + 500, "half a second of cycles")
    assert snapshot(arm).mode == Mode.CALIBRATING
    with ServoClient(arm) as servo:
        servo.power_off()


def snapshot(arm: str) -> ServoSnapshot:
    """State of the running servo."""
    memory = attach_servo_memory(arm)
    state = ServoMailbox(memory.words).snapshot()
    memory.close()
    return state


def flags(arm: str) -> int:
    """FLAG_* of the running servo, which is off."""
    state = snapshot(arm)
    assert state.mode == Mode.OFF or state.tick == 0
    return state.flags
