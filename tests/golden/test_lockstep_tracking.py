"""The QRobot paper's experiment in lock-step: park, end at constant speed, park at triple speed, and how it tracked.

Bounds on both sides: what the law has to reach, and what plain PD must not reach by accident. The mismatched plant has
friction, torque gain, gravity and stiction that the controller does not know.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from qrobot.arrays import Floats
from qrobot.config import load_robot
from qrobot.hwif.registers import DAC_ZERO
from qrobot.modecodes import Mode
from qrobot.motion import Generator, JointSpeed, MoveRequest, motion_limits
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.memory.telemetry import Rows
from qrobot.servo.settings import ServoSettings
from qrobot.servo.stages.setpoint_stream import longest_silence
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.mismatch import PlantMismatch

FRAME_S = 0.028
FRAME_NS = 28_000_000
ROBOT = load_robot("puma560")
N = ROBOT.n
SLOW = 0.35  # rad/s of the fastest joint; the way back is three times as fast

MAJOR, MINOR = slice(0, 3), slice(3, 6)


@cache
def setpoints() -> Floats:
    """The paper's two legs, one row per 28 ms."""
    generator = Generator(motion_limits(ROBOT), FRAME_S, ROBOT.poses["park"])
    for name, speed in (("end", SLOW), ("park", 3.0 * SLOW)):
        generator.push(MoveRequest(name, ROBOT.poses[name], JointSpeed(speed)))
    rows, tick = [ROBOT.poses["park"]], 0
    while True:
        tick += 1
        output = generator.update(tick)
        rows.append(output.q)
        if not output.moving:
            return np.array([*rows, *[output.q] * 10])


def new_rig(rate_hz: float = 1000.0, law: str = "qrobot", plant: str = "nominal") -> LockstepRig:
    wrong = PlantMismatch.mismatched(N) if plant == "mismatched" else PlantMismatch.nominal(N)
    return LockstepRig(ROBOT, ServoSettings(rate_hz=rate_hz, law=law), Emulator(ROBOT, mismatch=wrong))


def power_on(rig: LockstepRig) -> None:
    rig.ticks(3)
    rig.mailbox.request_power(True)
    rig.run_for(0.3)
    assert rig.mailbox.snapshot().mode == Mode.HOLDING


@dataclass(frozen=True, eq=False)
class Run:
    rows: Rows
    missed: int

    @property
    def error(self) -> Floats:
        """Largest absolute tracking error per joint, rad."""
        tracked = self.rows[self.rows["mode"] == Mode.TRACKING]
        return np.abs(tracked["q_ref"] - tracked["q"]).max(axis=0)

    @property
    def digest(self) -> str:
        return hashlib.sha256(self.rows.tobytes()).hexdigest()


def fly(rate_hz: float, law: str, plant: str) -> Run:
    rig = new_rig(rate_hz, law, plant)
    power_on(rig)
    for seq, q in enumerate(setpoints()):
        rig.mailbox.push_setpoint(1, seq, rig.now_ns, FRAME_NS, [POSITION_SETPOINT] * N, q.tolist())
        rig.run_for(FRAME_S)
    seen = rig.mailbox.snapshot()
    assert seen.mode == Mode.TRACKING
    assert seen.event == 0
    return Run(rig.rows(), seen.missed_frames)


experiment = cache(fly)


def test_the_experiment_is_the_papers() -> None:
    path = setpoints()
    speed = np.abs(np.diff(path, axis=0)).max(axis=1) / FRAME_S
    end = int(np.argmin(np.abs(path - ROBOT.poses["end"]).max(axis=1)))
    assert np.abs(path[end] - ROBOT.poses["end"]).max() < 0.15  # turned round in a transition, not reached
    assert np.median(speed[:end]) == pytest.approx(SLOW, rel=0.02)
    assert speed.max() == pytest.approx(3.0 * SLOW, rel=0.03)
    np.testing.assert_allclose(path[-1], ROBOT.poses["park"], atol=1e-12)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("rate_hz", [1000.0, 2000.0, 4000.0])
@pytest.mark.parametrize(("plant", "major_mrad", "minor_mrad"), [("nominal", 5.0, 2.0), ("mismatched", 10.0, 4.0)])
def test_the_qrobot_law_tracks_within_the_bounds(
    plant: str, major_mrad: float, minor_mrad: float, rate_hz: float
) -> None:
    error = 1e3 * experiment(rate_hz, "qrobot", plant).error
    assert error[MAJOR].max() <= major_mrad
    assert error[MINOR].max() <= minor_mrad


@pytest.mark.parametrize("plant", ["nominal", "mismatched"])
def test_pd_alone_is_at_least_twice_as_bad_on_the_major_joints(plant: str) -> None:
    ours, plain = experiment(1000.0, "qrobot", plant).error, experiment(1000.0, "pd", plant).error
    assert plain[MAJOR].max() >= 2.0 * ours[MAJOR].max()
    assert np.all(plain[MAJOR] >= 2.0 * ours[MAJOR])


def test_feed_forward_of_the_acceleration_makes_it_better_still() -> None:
    without, with_it = experiment(1000.0, "qrobot", "nominal").error, experiment(1000.0, "qrobot+a", "nominal").error
    assert with_it[MAJOR].max() < without[MAJOR].max()


def test_the_full_model_makes_it_best_while_it_is_true() -> None:
    constant, full = (experiment(1000.0, law, "nominal").error for law in ("qrobot+a", "computed-torque"))
    assert np.all(full[MAJOR] < 0.95 * constant[MAJOR])


def test_the_original_servo_boards_are_no_better_than_pd() -> None:
    boards, plain = (experiment(1000.0, law, "nominal").error for law in ("unimation", "pd"))
    assert np.all(boards < 1.1 * plain)
    assert np.all(boards[MAJOR] > 2.0 * experiment(1000.0, "qrobot", "nominal").error[MAJOR])


@pytest.mark.parametrize("plant", ["nominal", "mismatched"])
def test_one_two_and_four_kilohertz_agree_within_ten_percent(plant: str) -> None:
    worst = [experiment(rate, "qrobot", plant).error for rate in (1000.0, 2000.0, 4000.0)]
    for part in (MAJOR, MINOR):
        peaks = [error[part].max() for error in worst]
        assert max(peaks) <= 1.1 * min(peaks)


def test_two_runs_are_bit_identical_and_different_plants_are_not() -> None:
    again = fly(1000.0, "qrobot", "mismatched")
    assert again.digest == experiment(1000.0, "qrobot", "mismatched").digest
    assert again.digest != experiment(1000.0, "qrobot", "nominal").digest


def test_no_frame_is_missed_and_no_joint_is_saturated() -> None:
    run = experiment(1000.0, "qrobot", "mismatched")
    assert run.missed == 0
    assert np.all((run.rows["flags"] >> 8) & 0xFF == 0)


# ------------------------------------------------------------------------------------------- with a plant behind it


@pytest.mark.parametrize("plant", ["nominal", "mismatched"])
@pytest.mark.parametrize("rate_hz", [1000.0, 4000.0])
def test_power_on_moves_no_encoder_by_more_than_a_count(rate_hz: float, plant: str) -> None:
    rig = new_rig(rate_hz, plant=plant)
    rig.ticks(3)
    before = rig.state.counts.copy()
    rig.mailbox.request_power(True)
    rig.run_for(1.0)
    rows = rig.rows()
    assert rows["mode"][-1] == Mode.HOLDING
    assert np.abs(rows["counts"][3:] - before).max() <= (1 if plant == "nominal" else 30)
    powering = rows[rows["mode"] == Mode.POWERING]
    assert len(powering) > 0
    assert np.all(powering["dac"] == DAC_ZERO)


def test_the_arm_stops_on_its_path_when_the_frames_stop() -> None:
    rig = new_rig(4000.0)
    power_on(rig)
    path = setpoints()
    start = int(np.argmax(np.abs(np.diff(path, axis=0)).max(axis=1)))  # into the fast leg
    for seq, q in enumerate(path[: start + 5]):
        rig.mailbox.push_setpoint(1, seq, rig.now_ns, FRAME_NS, [POSITION_SETPOINT] * N, q.tolist())
        rig.run_for(FRAME_S)
    last_ns = rig.now_ns - FRAME_NS
    rig.run_for(1.0)
    rows = rig.rows()
    stop = rows[rows["mode"] == Mode.STOPPING]
    assert stop["t_ns"][0] - last_ns <= longest_silence(FRAME_NS, rig.period_ns) + rig.period_ns
    assert rows["mode"][-1] == Mode.HOLDING
    assert np.abs(stop["q_ref"] - stop["q"]).max() <= 8e-3  # the stop is harder than any motion of the experiment
    direction = path[start + 4] - path[start + 3]
    moved = stop["q"] - stop["q"][0]
    along = moved @ direction / (direction @ direction)
    off_path = moved - np.outer(along, direction)
    assert np.abs(off_path).max() <= 5e-3
    assert along[-1] > 1.0


def test_power_off_in_the_fast_leg_brings_the_arm_to_rest_before_the_brakes_close() -> None:
    rig = new_rig(1000.0)
    power_on(rig)
    for seq, q in enumerate(setpoints()[:150]):
        rig.mailbox.push_setpoint(1, seq, rig.now_ns, FRAME_NS, [POSITION_SETPOINT] * N, q.tolist())
        rig.run_for(FRAME_S)
    rig.mailbox.request_power(False)
    while rig.emulator.powered:
        speed = np.abs(rig.emulator.v).max()
        rig.ticks(1)
    assert speed < 0.05
    rig.run_for(0.2)
    assert rig.emulator.braked
    assert rig.mailbox.snapshot().mode == Mode.OFF
