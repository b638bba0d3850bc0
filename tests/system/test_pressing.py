"""The law `force` presses on a table, on virtual time: judged by the plant's own contact force, not by the sensor."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from qrobot.config.scene import ForceSensor, Scene
from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.mujoco_plant import PlantMemory
from tests.support.pressing import ROBOT, tip_down
from tests.support.puma import arm

TABLE = Scene(kind="table")
SENSOR = ForceSensor(channels={"fz": 6})
WANTED, CREEP, TRAVEL, GAIN, TRIM = 20.0, 0.01, 0.02, 1.0, 15.0  # N, m/s, m, -, N: the law's defaults
LOOK_S = 0.002
FRICTION_N = 30.0  # more than the joints' friction can hold back at the tip, in this pose


class Phase(NamedTuple):
    """What was seen every two milliseconds."""

    force: np.ndarray  # N, up
    tip: np.ndarray  # m, height in the base frame
    mode: Mode
    fault: FaultCode


class Press:
    """An arm above the table, whose servo runs the law."""

    def __init__(self, law: str = "force") -> None:
        start = tip_down(0.5, 0.1, -0.297, TABLE)
        self.emulator = Emulator(ROBOT, scene=TABLE, force_sensor=SENSOR, start=start)
        settings = ServoSettings(law=law, sensor_channels=(6,))
        self.rig = LockstepRig(ROBOT, settings, self.emulator, keep_telemetry=False)
        self.rig.run_for(0.05)
        self.rig.mailbox.request_power(True)
        assert isinstance(self.emulator.plant, PlantMemory)
        self.plant = self.emulator.plant

    def watch(self, seconds: float) -> Phase:
        """Let time run."""
        force, tip = [], []
        for _ in range(round(seconds / LOOK_S)):
            self.rig.run_for(LOOK_S)
            force.append(self.plant.contact_force()[2])
            T = arm().forward(self.emulator.q)
            tip.append(T[2, 3] + T[2, 2] * (TABLE.tool.length_m + ROBOT.geometry.flange_m))
        snapshot = self.rig.mailbox.snapshot()
        return Phase(np.array(force), np.array(tip), Mode(snapshot.mode), FaultCode(snapshot.fault))


@pytest.fixture(scope="module")
def press() -> dict[str, Phase]:
    """One arm finds the table, loses it, meets it coming up; then its sensor dies, and recovers."""
    one = Press()
    phases = {"first": one.watch(2.5)}
    one.plant.move_scene((0.5, 0.0, -0.308))
    phases["lowered"] = one.watch(2.5)
    one.plant.move_scene((0.5, 0.0, -0.6))
    phases["lost"] = one.watch(2.0)
    for rise in np.linspace(0.0, 0.004, 400):
        one.plant.move_scene((0.5, 0.0, phases["lost"].tip[-1] + rise))
        one.watch(LOOK_S)
    phases["again"] = one.watch(4.0)
    gain = one.emulator.bundle.wrist.gain.copy()
    one.emulator.bundle.wrist.gain[:] = 0.0
    phases["dead"] = one.watch(2.0)
    one.emulator.bundle.wrist.gain[:] = gain
    phases["alive"] = one.watch(4.0)
    one.emulator.bundle.wrist.gain[:] = 100.0 * gain
    phases["overloaded"] = one.watch(0.1)
    return phases


@pytest.mark.sampled(2)
@pytest.mark.parametrize("phase", ["first", "lowered", "again", "alive"])
def test_the_arm_presses_with_the_force_asked_for_to_one_in_twenty(press, phase) -> None:
    steady = press[phase].force[-100:]
    assert press[phase].mode is Mode.HOLDING
    assert np.abs(steady - WANTED).max() < 0.05 * WANTED


def test_the_first_contact_is_bounded_and_the_tip_does_not_jump_off_again(press) -> None:
    force = press["first"].force
    touches = np.count_nonzero(np.diff(force > 0.0) & (force[1:] > 0.0))
    assert 1 <= touches <= 2
    assert force.max() < 3.0 * WANTED
    assert force[np.argmax(force > 0.0) + 50 :].max() < 2.0 * WANTED  # a tenth of a second later


def test_the_sensor_finds_its_zero_before_the_arm_moves(press) -> None:
    """While it does the tip stays within a tenth of a millimetre."""
    assert np.ptp(press["first"].tip[:120]) < 1e-4


def test_an_arm_that_has_lost_its_table_creeps_no_faster_and_no_farther_than_allowed(press) -> None:
    lost = press["lost"]
    assert lost.mode is Mode.HOLDING
    assert not lost.force.any()
    assert -np.diff(lost.tip[::50]).min() < 1.3 * CREEP * 50 * LOOK_S + 1e-3  # and what the spring had stored
    assert -0.297 - TRAVEL - 1e-3 < lost.tip[-1] < -0.31
    assert np.ptp(lost.tip[-100:]) < 1e-4


def test_a_dead_sensor_lets_the_force_grow_no_further_than_gain_and_trim(press) -> None:
    dead = press["dead"]
    assert dead.mode is Mode.HOLDING
    assert dead.force.max() < (1.0 + GAIN) * WANTED + TRIM + FRICTION_N
    assert dead.force[-1] > WANTED


def test_a_sensor_at_the_end_of_the_converters_range_stops_the_arm(press) -> None:
    assert press["overloaded"].fault is FaultCode.LAW_NAN


def test_the_same_run_again_is_the_same_to_the_last_bit(press) -> None:
    assert Press().watch(1.5).force.tobytes() == press["first"].force[:750].tobytes()


def test_without_a_table_in_reach_the_law_is_qrobots_until_its_tare_is_done() -> None:
    forces = [Press(law).watch(0.2).tip for law in ("force", "qrobot")]
    np.testing.assert_allclose(forces[0], forces[1], atol=1e-7)
