"""The emulated robot as a whole: what a controller would see at the registers and what the arm really does."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from qrobot.arrays import Words
from qrobot.config import Robot, load_robot
from qrobot.config.robot import Joints
from qrobot.errors import ConfigError
from qrobot.hwif.board_memory import Lane, fetch_image, local_board_memory
from qrobot.hwif.image import IMAGE_T_NS, make_image
from qrobot.hwif.lanes import post_operations
from qrobot.hwif.operations import OP_WRITE
from qrobot.hwif.registers import (
    DAC,
    DAC_ZERO,
    DISCRETE,
    DISCRETE_INDEX,
    DISCRETE_POWER,
    ENC_COUNT,
    ENC_INDEX,
    STATUS,
    STATUS_CALIBRATED,
    STATUS_INDEX,
    STATUS_POWER,
)
from qrobot.hwif.trace import read_trace
from qrobot.model.transmission import counts_to_joint, signed_word, transmission_params
from qrobot.sim_board.board import BoardOptions
from qrobot.sim_board.emulator import Emulator, advance, emulator_run
from qrobot.sim_board.mismatch import PlantMismatch
from qrobot.sim_board.server import catch_up
from tests.support.bench import post, read_word
from tests.support.bus import rows_of

PUMA, STANFORD = load_robot("puma560"), load_robot("stanford")
ROBOTS = pytest.mark.parametrize("robot", [PUMA, STANFORD], ids=["puma560", "stanford"])
STEPS_PER_S = 4000
MS, STEP_NS = 1_000_000, 250_000
COUNT = np.abs(PUMA.transmission.rad_per_count)


class Rig:
    """An emulator in lock-step with its memory and virtual time."""

    def __init__(self, robot: Robot = PUMA, **choices: object) -> None:
        self.robot = robot
        self.emulator = Emulator(robot, **choices)  # type: ignore[arg-type]
        self.memory: Words = local_board_memory()
        self.t_ns = 0
        self.emulator.connect(self.memory)

    def run(self, seconds: float) -> None:
        self.t_ns = emulator_run(self.emulator.bundle, self.memory, self.t_ns, round(seconds * STEPS_PER_S))

    def write(self, *pairs: tuple[int, int]) -> None:
        post(self.memory, *((OP_WRITE, offset, value) for offset, value in pairs))

    def power_on(self) -> None:
        self.write((DISCRETE, DISCRETE_POWER))
        self.run(0.05)
        assert not self.emulator.braked

    def push(self, joint: int, torque: float) -> None:
        self.memory.panel.push[joint] = round(torque * 1e6)

    def torque(self, joint: int, torque: float) -> None:
        code = DAC_ZERO + round(torque * self.robot.transmission.dac_per_Nm[joint])
        self.write((DAC + 2 * joint, code))

    def q_read(self) -> NDArray[np.float64]:
        """Joint positions as a host computes them from the counters."""
        counts = [signed_word(read_word(self.memory, ENC_COUNT + 2 * i)) for i in range(self.robot.n)]
        q = np.zeros(self.robot.n)
        counts_to_joint(np.array(counts), transmission_params(self.robot), q)
        return q


# --- catching up ---------------------------------------------------------------------------------------------------


def test_a_board_that_catches_up_applies_each_write_from_its_own_time_on() -> None:
    """A stall of 20 ms, in which the servo wrote 5 N m and took it back after 10 ms: the arm is where it had been."""
    late, punctual = Rig(physics="rigid"), Rig(physics="rigid")
    for rig in (late, punctual):
        rig.power_on()
    words = [(5 * MS, 5.0), (15 * MS, 0.0)]
    for after_ns, torque in words:
        rows = [(OP_WRITE, DAC, DAC_ZERO + round(torque * PUMA.transmission.dac_per_Nm[0]))]
        post_operations(late.memory, Lane.SERVO, rows_of(rows), 1, late.t_ns + after_ns)
    shown = int(late.memory.shown.sequence)
    catch_up(late.emulator.bundle, late.memory, late.t_ns + STEP_NS, late.t_ns + 20 * MS)
    assert late.memory.shown.sequence == shown + 2  # one image alone is shown, that of the present
    assert late.memory.shown.image[IMAGE_T_NS] == late.t_ns + 20 * MS
    for step in range(1, 81):
        for after_ns, torque in words:
            if after_ns == step * STEP_NS:
                punctual.torque(0, torque)
        now_ns = punctual.t_ns + step * STEP_NS
        advance(punctual.emulator.bundle, punctual.memory, now_ns, now_ns)
    np.testing.assert_array_equal(late.emulator.q, punctual.emulator.q)
    assert abs(late.emulator.v[0]) > 1e-4
    stamps = read_trace(late.memory)[-2:, 0] - late.t_ns
    assert stamps.tolist() == [after_ns for after_ns, _torque in words]


def test_an_operation_without_a_time_or_with_a_damaged_one_acts_at_once() -> None:
    rig = Rig(physics="rigid")
    rig.power_on()
    for t_ns in (0, rig.t_ns + 10_000 * MS, -1):
        post_operations(rig.memory, Lane.SERVO, rows_of([(OP_WRITE, DAC, DAC_ZERO + 7)]), 1, t_ns)
    rig.run(1 / STEPS_PER_S)
    assert len(read_trace(rig.memory)) == 4


# --- power-up ----------------------------------------------------------------------------------------------------


@ROBOTS
@pytest.mark.parametrize("pose", ["park", "ready", "end"])
def test_a_calibrated_emulator_shows_its_true_pose_at_the_counters(robot: Robot, pose: str) -> None:
    rig = Rig(robot, start=pose)
    half_counts = np.abs(np.linalg.inv(robot.transmission.coupling)) @ np.abs(robot.transmission.rad_per_count) / 2
    assert (np.abs(rig.q_read() - robot.poses[pose]) <= half_counts * (1 + 1e-9)).all()
    assert read_word(rig.memory, STATUS) & STATUS_CALIBRATED
    np.testing.assert_array_equal(rig.emulator.q, robot.poses[pose])


def test_an_uncalibrated_emulator_counts_from_zero_where_it_stands() -> None:
    rig = Rig(calibrated=False)
    assert [read_word(rig.memory, ENC_COUNT + 2 * i) for i in range(6)] == [0] * 6
    assert not read_word(rig.memory, STATUS) & STATUS_CALIBRATED


@pytest.mark.parametrize("revision", ["E", "F"])
def test_the_board_states_its_period_joints_and_revision(revision: str) -> None:
    rig = Rig(STANFORD, options=BoardOptions(revision_f=revision == "F"), plant_hz=8000)
    assert rig.memory.facts.period_ns == 125_000
    assert rig.memory.facts.joints == 6
    assert rig.memory.facts.revision == ord(revision)


def test_presses_of_the_past_do_not_power_a_new_board() -> None:
    emulator = Emulator(PUMA, options=BoardOptions(auto_panel=False))
    memory = local_board_memory()
    memory.panel.presses = 3
    emulator.connect(memory)
    post(memory, (OP_WRITE, DISCRETE, DISCRETE_POWER))
    emulator_run(emulator.bundle, memory, 0, 1)
    assert not emulator.powered


@pytest.mark.parametrize(
    ("choices", "message"),
    [
        ({"start": "nowhere"}, "no pose 'nowhere', only"),
        ({"friction": "none"}, "no friction preset 'none'"),
    ],
)
def test_what_the_robot_file_does_not_have_is_refused(choices: dict[str, str], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        Emulator(PUMA, **choices)  # type: ignore[arg-type]


def test_an_arm_with_more_joints_than_the_board_has_encoders_is_refused() -> None:
    joints = Joints(names=tuple("abcdefg"), kinds=("revolute",) * 7)
    with pytest.raises(ConfigError, match=r"7 joints, and a board 6 encoder channels: .* off line"):
        Emulator(PUMA.model_copy(update={"joints": joints}))


# --- time --------------------------------------------------------------------------------------------------------


def test_an_operation_acts_in_the_step_after_it_was_posted_and_the_image_is_that_of_the_steps_end() -> None:
    rig = Rig()
    rig.run(0.01)
    rig.write((DISCRETE, DISCRETE_POWER))
    posted = rig.t_ns
    rig.run(1 / STEPS_PER_S)
    image = make_image()
    fetch_image(rig.memory, image)
    assert read_trace(rig.memory)[-1, 0] == posted
    assert image[IMAGE_T_NS] == posted + 250_000 == rig.t_ns
    assert read_word(rig.memory, STATUS) & STATUS_POWER


def random_run(rounds: int) -> str:
    """State of a mismatched arm after random torques, to the last bit."""
    rig, random = Rig(mismatch=PlantMismatch.mismatched(6)), np.random.default_rng(3)
    rig.write((DISCRETE, DISCRETE_POWER))
    for _ in range(rounds):
        rig.write(*((DAC + 2 * i, int(word)) for i, word in enumerate(random.integers(1000, 3000, 6))))
        rig.run(8 / STEPS_PER_S)
    return f"{rig.emulator.q.tobytes().hex()} {rig.emulator.v.tobytes().hex()}"


def test_runs_are_bit_identical_and_differ_by_one_step_of_torque() -> None:
    assert random_run(200) == random_run(200) != random_run(201)


def test_a_run_in_another_process_with_the_jit_off_is_bit_identical() -> None:
    command = [sys.executable, "-c", "from tests.unit.sim_board.test_emulator import random_run; print(random_run(25))"]
    environment, root = os.environ | {"NUMBA_DISABLE_JIT": "1"}, Path(__file__).parents[3]
    done = subprocess.run(command, env=environment, cwd=root, check=True, stdout=subprocess.PIPE, text=True)
    assert done.stdout.strip() == random_run(25)


# --- brakes, stiction, gravity -----------------------------------------------------------------------------------


def test_with_power_off_brakes_hold_joints_1_to_3_against_a_push_and_the_wrist_gives_way() -> None:
    rig = Rig()
    for joint, torque in enumerate([90.0, 150.0, 80.0, 5.0, 5.0, 5.0]):
        rig.push(joint, torque)
    start = rig.emulator.q
    rig.run(0.5)
    moved = np.abs(rig.emulator.q - start)
    assert (moved[:3] < COUNT[:3]).all()
    assert (moved[3:] > 0.2).all()


def test_with_power_off_the_amplifiers_give_no_torque_whatever_the_dacs_hold() -> None:
    rig = Rig()
    start = rig.emulator.q
    rig.write(*((DAC + 2 * i, 0) for i in range(6)))
    rig.run(0.5)
    assert (np.abs(rig.emulator.q - start) < COUNT).all()


def test_an_arm_held_by_stiction_does_not_creep_a_count_in_ten_seconds() -> None:
    """Every joint loaded to 80 % of its friction, brakes open."""
    rig = Rig(start="ready")
    rig.power_on()
    friction = PUMA.friction[PUMA.control.friction_preset]
    for joint in (0, 3, 5):
        rig.push(joint, 0.8 * friction.coulomb_pos[joint])
    rig.push(1, -0.8 * friction.coulomb_neg[1] - 0.775)  # gravity at READY, -0.775 and 0.249 N m
    rig.push(2, 0.8 * friction.coulomb_pos[2] + 0.249)
    rig.run(0.2)
    start = rig.emulator.q
    rig.run(10.0)
    assert (np.abs(rig.emulator.q - start) < 0.01 * COUNT).all()


def test_an_arm_without_brakes_and_torque_falls_when_gravity_exceeds_friction() -> None:
    """At the zero pose joint 2 carries 37 N m and holds 7.65 to 13.6 N m by friction; joint 1 carries nothing."""
    rig = Rig(start="zero")
    rig.power_on()
    start = rig.emulator.q
    rig.run(0.3)
    fallen = rig.emulator.q - start
    assert fallen[1] > 0.1  # VAL: positive is down
    assert abs(fallen[0]) < COUNT[0]


def test_a_falling_arm_is_stopped_when_power_drops_and_the_brakes_close() -> None:
    rig = Rig(start="zero")
    rig.power_on()
    rig.run(0.2)
    assert rig.emulator.v[1] > 0.5
    rig.write((DISCRETE, 0))
    rig.run(0.1)
    stopped = rig.emulator.q
    assert rig.emulator.braked
    rig.run(1.0)
    assert (np.abs(rig.emulator.q - stopped)[:3] < COUNT[:3]).all()


# --- torque and motion -------------------------------------------------------------------------------------------


def test_a_dac_step_accelerates_joint_1_as_its_inertia_and_friction_say() -> None:
    """READY: inertia 2.34 kg m2 (published mass matrix), Coulomb 24.73 N m, viscous 5.802 N m s/rad."""
    rig = Rig(start="ready")
    rig.power_on()
    rig.torque(0, 60.0)
    rig.run(0.1)
    inertia, viscous, driving = 2.34, 5.802, 60.0 - 24.73
    expected = driving / viscous * (1.0 - np.exp(-viscous / inertia * 0.1))
    assert rig.emulator.v[0] == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("joint", range(6))
def test_positive_torque_turns_a_joint_positive_and_its_counter_by_its_sign(joint: int) -> None:
    rig = Rig(start="ready")
    rig.power_on()
    before = [read_word(rig.memory, ENC_COUNT + 2 * i) for i in range(6)]
    start = rig.emulator.q
    rig.torque(joint, 0.6 * 2048 / abs(PUMA.transmission.dac_per_Nm[joint]))
    rig.run(0.1)
    delta = signed_word(read_word(rig.memory, ENC_COUNT + 2 * joint) - before[joint])
    assert rig.emulator.q[joint] - start[joint] > 0.005
    assert np.sign(delta) == PUMA.transmission.count_sign[joint]
    assert (np.abs(rig.q_read() - rig.emulator.q) < 2 * COUNT).all()


def test_a_mismatched_plant_moves_differently_under_the_same_torque() -> None:
    speeds = []
    for mismatch in (PlantMismatch.nominal(6), PlantMismatch.mismatched(6)):
        rig = Rig(start="ready", mismatch=mismatch)
        rig.power_on()
        rig.torque(0, 60.0)
        rig.run(0.1)
        speeds.append(rig.emulator.v[0])
    assert abs(speeds[1] / speeds[0] - 1.0) > 0.1


def test_index_pulses_come_at_the_phase_of_the_robot_file() -> None:
    """The latched counts of a calibrated arm, offset removed, are congruent to the phase modulo counts per turn."""
    rig = Rig(start="ready", options=BoardOptions(relatch=False))
    rig.power_on()
    rig.write((DISCRETE, DISCRETE_POWER), (DISCRETE, DISCRETE_POWER | DISCRETE_INDEX))
    for joint in range(6):
        rig.torque(joint, 0.5 * 2048 / abs(PUMA.transmission.dac_per_Nm[joint]))
    rig.run(0.4)
    assert read_word(rig.memory, STATUS) & STATUS_INDEX == 0
    transmission = PUMA.transmission
    latched = np.array([signed_word(read_word(rig.memory, ENC_INDEX + 2 * i)) for i in range(6)])
    phase = (latched - transmission.count_offset) % transmission.counts_per_rev
    np.testing.assert_array_equal(phase, transmission.index_phase)


def test_a_sliding_joint_slides_to_its_motor_and_back_is_held() -> None:
    """The Stanford arm's boom: 150 N against 15 N of friction moves it out; the brake then holds it."""
    rig = Rig(STANFORD, start="ready")
    rig.power_on()
    start = rig.emulator.q[2]
    rig.torque(2, 150.0)
    rig.run(0.1)
    out = rig.emulator.q[2]
    assert out - start > 0.01
    assert abs(rig.q_read()[2] - out) < 2 * STANFORD.transmission.rad_per_count[2]
    rig.write((DISCRETE, 0))
    rig.run(0.2)
    held = rig.emulator.q[2]
    rig.push(2, 100.0)
    rig.run(0.5)
    assert abs(rig.emulator.q[2] - held) < STANFORD.transmission.rad_per_count[2]
