"""Six drives instead of a board: their state machine, what the registers show of them, and a move in lock-step."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.errors import LinkLost, LinkTimeout, RemoteProtocolError
from qrobot.faultcodes import FaultCode
from qrobot.hwif.board_memory import local_board_memory
from qrobot.hwif.bus import Endpoint
from qrobot.hwif.canbus.drives import DrivesBus
from qrobot.hwif.canbus.ds402 import (
    CYCLIC_TORQUE,
    DISABLE_VOLTAGE,
    ENABLE_OPERATION,
    FAULT_RESET,
    QUICK_STOP,
    SHUTDOWN,
    SWITCH_ON,
    DriveState,
    state_of,
    towards_operation,
)
from qrobot.hwif.gateway import Gateway
from qrobot.hwif.image import IMAGE_T_NS
from qrobot.hwif.operations import OP_WRITE
from qrobot.hwif.registers import (
    DAC,
    DAC_ZERO,
    DISCRETE,
    DISCRETE_CALIBRATED,
    DISCRETE_POWER,
    ENC_LOAD,
    STATUS_CALIBRATED,
    STATUS_ESTOP_OK,
    STATUS_POWER,
)
from qrobot.modecodes import Mode
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.bus import BenchEndpoint, Row
from tests.support.drives import NODES, Drives, served
from tests.support.emulated_drives import EmulatedDrive
from tests.support.patience import MOMENT_S, PATIENCE_S, wait_until
from tests.support.transport_rig import TransportRig

ROBOT = load_robot("puma560")
ON: Row = (OP_WRITE, DISCRETE, DISCRETE_POWER)
OFF: Row = (OP_WRITE, DISCRETE, 0)
OVERCURRENT = 0x2310
IO_PROFILE = 401
START_NS = 1_000_000_000
STEPS_UP = 4  # exchanges: three transitions, and one that shows the last


@pytest.fixture
def drives() -> Iterator[Drives]:
    with served(BenchEndpoint()) as drives:
        drives.bus.connect()
        yield drives


def test_an_answer_that_is_read_late_tells_of_the_time_at_which_the_drives_sampled(
    drives: Drives, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half of the delay in the stamp would be a speed that is half as high, and then one that is too high."""
    now_ns, collect = [START_NS], drives.bus._collect

    def collect_late() -> None:
        now_ns[0] += 8_000_000
        collect()

    monkeypatch.setattr(drives.bus, "_virtual_time", False)
    monkeypatch.setattr(drives.bus, "_now_ns", lambda: now_ns[0])
    monkeypatch.setattr(drives.bus, "_collect", collect_late)
    drives.exchange()
    assert drives.image[IMAGE_T_NS] == START_NS


def test_a_drive_comes_up_by_the_control_words_that_its_status_asks_for() -> None:
    drive, seen = EmulatedDrive(), []
    for _ in range(4):
        drive.control(towards_operation(drive.status))
        seen.append(drive.state)
    assert seen == [DriveState.READY, DriveState.SWITCHED_ON, DriveState.ENABLED, DriveState.ENABLED]


@pytest.mark.parametrize("state", list(DriveState))
def test_a_state_is_recognised_by_its_status_word_whatever_its_other_bits(state: DriveState) -> None:
    mask, value = state.value
    assert state_of(value) is state
    assert state_of(value | 0xFFFF & ~mask) is state


@pytest.mark.parametrize(
    ("state", "word", "then"),
    [
        (DriveState.ENABLED, QUICK_STOP, DriveState.QUICK_STOPPED),
        (DriveState.ENABLED, DISABLE_VOLTAGE, DriveState.SWITCH_ON_DISABLED),
        (DriveState.ENABLED, SHUTDOWN, DriveState.READY),
        (DriveState.QUICK_STOPPED, DISABLE_VOLTAGE, DriveState.SWITCH_ON_DISABLED),
        (DriveState.SWITCH_ON_DISABLED, ENABLE_OPERATION, DriveState.SWITCH_ON_DISABLED),
        (DriveState.READY, ENABLE_OPERATION, DriveState.READY),
        (DriveState.FAULT, SWITCH_ON, DriveState.FAULT),
        (DriveState.FAULT, FAULT_RESET, DriveState.SWITCH_ON_DISABLED),
    ],
)
def test_the_emulated_drive_makes_the_transitions_of_the_standard_and_no_other(
    state: DriveState, word: int, then: DriveState
) -> None:
    drive = EmulatedDrive(state)
    drive.control(word)
    assert drive.state is then


def test_power_is_on_once_every_drive_is_and_torque_flows_only_then(drives: Drives) -> None:
    torque: Row = (OP_WRITE, DAC, DAC_ZERO - 100)
    for _ in range(STEPS_UP - 1):
        assert not drives.exchange(ON, torque) & STATUS_POWER or drives.far.drives[0].torque == 0
    assert drives.exchange(times=2) & STATUS_POWER
    assert drives.far.drives[0].torque == 100
    assert drives.far.drives[0].mode == CYCLIC_TORQUE
    assert not drives.exchange(OFF, times=2) & STATUS_POWER
    assert {drive.next_torque() for drive in drives.far.drives} == {0}


def test_a_converter_word_is_torque_in_thousandths_with_the_sign_of_its_joint(drives: Drives) -> None:
    drives.exchange(ON, times=STEPS_UP)
    drives.exchange(*((OP_WRITE, DAC + 2 * joint, DAC_ZERO - 200) for joint in range(6)))
    assert [drive.torque for drive in drives.far.drives] == [200, -200, 200, 100, -100, 200]
    assert drives.far.end.bench.board.dac[:6].tolist() == [DAC_ZERO - 200] * 6  # type: ignore[attr-defined]


def test_counters_take_loads_and_count_on_in_counts_whatever_the_increments(drives: Drives) -> None:
    drives.exchange(*((OP_WRITE, ENC_LOAD + 2 * joint, 0xFFF0) for joint in range(6)))
    end = drives.far.end
    for joint in range(6):
        end.bench.shaft[joint] = 40.0 * (-1) ** joint  # type: ignore[attr-defined]
    drives.exchange(times=2)
    assert drives.counts() == [0x0018, 0xFFC8] * 3


@pytest.mark.parametrize("absolute", [True, False])
def test_absolute_encoders_calibrate_the_arm_and_others_leave_it_to_the_host(absolute: bool) -> None:
    with served(BenchEndpoint(), absolute) as drives:
        drives.bus.connect()
        assert bool(drives.exchange() & STATUS_CALIBRATED) == absolute
        assert drives.exchange((OP_WRITE, DISCRETE, DISCRETE_CALIBRATED)) & STATUS_CALIBRATED


def test_a_drive_that_fails_takes_the_others_along_until_power_is_asked_for_anew(drives: Drives) -> None:
    assert drives.exchange(ON, times=STEPS_UP) & STATUS_POWER
    drives.far.fail(3, OVERCURRENT)
    assert not drives.exchange() & STATUS_POWER
    assert not drives.exchange(ON, times=STEPS_UP + 2) & STATUS_POWER
    assert DriveState.ENABLED not in {drive.state for drive in drives.far.drives}
    drives.exchange(OFF)
    assert drives.exchange(ON, times=STEPS_UP + 1) & STATUS_POWER  # one more step: the fault is reset


def test_a_drive_that_stops_by_itself_is_an_emergency_stop(drives: Drives) -> None:
    assert drives.exchange(ON, times=STEPS_UP) & STATUS_ESTOP_OK
    drives.far.drives[4].state = DriveState.QUICK_STOPPED
    assert not drives.exchange() & (STATUS_ESTOP_OK | STATUS_POWER)


def test_a_drive_that_is_silent_is_named_with_what_it_complained_of(drives: Drives) -> None:
    drives.exchange(ON, times=STEPS_UP)
    drives.far.fail(5, OVERCURRENT)
    drives.silent.add(5)
    drives.hurry()
    image = drives.image.copy()
    wanted = "node 5 does not answer; emergency messages: 0x2310 of node 5"
    wait_until(lambda: wanted in drives.complaint(), "the one that is silent is named")
    assert drives.image.tolist() == image.tolist()


def states_but(drives: Drives, silent: int) -> set[DriveState]:
    """States of the drives that hear, whose node is not `silent`."""
    return {drive.state for node, drive in zip(NODES, drives.far.drives, strict=True) if node != silent}


@pytest.mark.parametrize("silent", [1, 3, 6])
def test_when_one_drive_is_silent_the_others_are_let_go_at_once(drives: Drives, silent: int) -> None:
    torque = [(OP_WRITE, DAC + 2 * joint, DAC_ZERO - 100) for joint in range(6)]
    assert drives.exchange(ON, *torque, times=STEPS_UP) & STATUS_POWER
    drives.silent.add(silent)
    drives.hurry()
    with pytest.raises(LinkTimeout, match="does not answer"):
        drives.exchange()
    wait_until(lambda: states_but(drives, silent) == {DriveState.SWITCH_ON_DISABLED})
    drives.silent.clear()
    drives.mend()
    assert not drives.exchange(times=STEPS_UP + 1) & STATUS_POWER  # nobody has asked for it anew


def test_drives_that_somebody_left_in_operation_are_let_go_before_all_are_found(
    drives: Drives, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert drives.exchange(ON, times=STEPS_UP) & STATUS_POWER
    monkeypatch.setattr("qrobot.hwif.canbus.link.SDO_TIMEOUT_S", MOMENT_S)
    drives.silent.add(1)
    drives.hurry()
    after = DrivesBus(drives.transport)
    after.link.timeout_s = MOMENT_S
    with pytest.raises(LinkTimeout, match="does not answer"):
        after.connect()
    wait_until(lambda: states_but(drives, 1) == {DriveState.SWITCH_ON_DISABLED})
    after.close()


def test_what_drives_tell_unasked_is_never_taken_for_the_answer(drives: Drives) -> None:
    for counts in (0, 100, 200, 300):
        for _ in range(3):
            drives.far.tell()
        drives.far.end.bench.shaft[:] = counts  # type: ignore[attr-defined]
        drives.exchange(times=2)
        assert drives.counts() == [counts] * 6


def test_a_drive_that_has_started_anew_between_two_exchanges_is_named(drives: Drives) -> None:
    drives.exchange()
    drives.far.boot()
    with pytest.raises(LinkLost, match="has started anew"):
        drives.exchange()


@pytest.mark.parametrize("absolute", [True, False])
def test_drives_that_were_lost_are_calibrated_by_absolute_encoders_alone(absolute: bool) -> None:
    with served(BenchEndpoint(), absolute) as drives:
        gateway = Gateway(drives.bus, local_board_memory(), 2_000_000)
        assert gateway.step(0)
        drives.exchange((OP_WRITE, DISCRETE, DISCRETE_CALIBRATED))  # by whoever has loaded the counters
        drives.far.boot()  # their supply was off, and their counters are zero
        assert not gateway.step(1)
        assert gateway.step(2)
        assert bool(drives.exchange() & STATUS_CALIBRATED) == absolute


@pytest.mark.parametrize("known", [True, False])
def test_a_node_that_is_no_drive_is_refused_and_not_written_to(drives: Drives, known: bool) -> None:
    torque = [(OP_WRITE, DAC + 2 * joint, DAC_ZERO - 100) for joint in range(6)]
    assert drives.exchange(ON, *torque, times=STEPS_UP) & STATUS_POWER
    stranger = drives.far.drives[2]
    stranger.profile = IO_PROFILE
    outputs = stranger.torque
    bus = drives.bus if known else DrivesBus(drives.transport)
    bus.link.timeout_s = PATIENCE_S
    for attempt in range(2):
        with pytest.raises(RemoteProtocolError, match=r"node 3 is no drive of CiA 402"):
            bus.connect()
        wait_until(lambda: states_but(drives, 3) == {DriveState.SWITCH_ON_DISABLED})
        if known and not attempt:  # it was a drive so far, and had to be let go
            stranger.state, stranger.torque = DriveState.ENABLED, outputs
    assert (stranger.state, stranger.torque) == (DriveState.ENABLED, outputs)
    bus.close()


def test_drives_that_miss_the_sync_stop_by_themselves(drives: Drives) -> None:
    drives.exchange(ON, times=STEPS_UP)
    drives.far.lose_sync()
    assert {drive.state for drive in drives.far.drives} == {DriveState.FAULT}
    assert not drives.exchange() & STATUS_POWER


def test_the_same_servo_moves_a_robot_with_drives() -> None:
    with ExitStack() as stack:
        opened: list[Drives] = []

        def open_bus(end: Endpoint) -> DrivesBus:
            opened.append(stack.enter_context(served(end)))
            return opened[0].bus

        rig = TransportRig(ROBOT, ServoSettings(rate_hz=500.0), open_bus, Emulator(ROBOT, physics="rigid"))
        rig.ticks(3)
        rig.mailbox.request_power(True)
        rig.run_for(0.3)
        assert rig.mailbox.snapshot().mode == Mode.HOLDING
        goal = ROBOT.poses["park"] + 0.03
        for frame in range(8):
            q = ROBOT.poses["park"] + 0.03 * min(frame, 6) / 6
            rig.mailbox.push_setpoint(1, frame, rig.now_ns, 28_000_000, [POSITION_SETPOINT] * 6, q.tolist())
            rig.run_for(0.028)
        assert rig.mailbox.snapshot().event == 0
        np.testing.assert_allclose(rig.emulator.q, goal, atol=0.01)
        opened[0].far.fail(2, OVERCURRENT)
        rig.run_for(0.1)
        assert rig.mailbox.snapshot().event == FaultCode.POWER_LOST
        assert not rig.emulator.powered
