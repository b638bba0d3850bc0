"""The wrist's force sensor: what the board converts is what pulls at the flange."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from qrobot.config.scene import ForceSensor, Scene
from qrobot.errors import ConfigError
from qrobot.hwif.board_memory import local_board_memory
from qrobot.sim_board.analog import input_volts, make_analog
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.wrist import make_wrist, no_wrist, sense_wrist
from tests.support.pressing import DT, ROBOT, HeldArm, tip_down

TABLE = Scene(kind="table")
QUIET = ForceSensor(channels={"fz": 6, "tx": 7}, zero_v=0.0, noise_v=0.0)
GRAVITY = 9.81


def analog(n_pots: int = 6):
    return make_analog(np.zeros(n_pots), 1.0, seed=1)


def test_the_sensor_of_an_arm_at_rest_reads_the_weight_of_its_tool() -> None:
    """With the tool pointing down its weight pulls the flange in the direction of its z, and turns nothing."""
    held = HeldArm(TABLE, tip_down(0.5, 0.1, -0.2, TABLE), sensed=True).run(0.5)
    wrist, inputs = make_wrist(QUIET, held.plant.wrist, analog(), DT, seed=0), analog()
    for _ in range(200):
        sense_wrist(wrist, inputs.external)
    weight = TABLE.tool.mass_kg * GRAVITY
    assert inputs.external[6] * QUIET.newton_per_volt == pytest.approx(weight, rel=1e-3)
    assert inputs.external[7] == pytest.approx(0.0, abs=1e-3)


def test_pressing_on_a_table_pushes_the_flange_back_by_the_contact_force_less_the_weight() -> None:
    held = HeldArm(TABLE, tip_down(0.5, 0.1, -0.295, TABLE), sensed=True)
    held.to(tip_down(0.5, 0.1, -0.31, TABLE), 0.3).run(0.5)
    wrist, external = make_wrist(QUIET, held.plant.wrist, analog(), DT, seed=0), np.zeros(8)
    for _ in range(200):
        sense_wrist(wrist, external)
    along = held.plant.data.body("tool").xmat.reshape(3, 3)[:, 2]
    pushed = held.plant.contact_force() @ along
    assert pushed < -20.0
    weight = -TABLE.tool.mass_kg * GRAVITY * along[2]
    assert external[6] * QUIET.newton_per_volt == pytest.approx(pushed + weight, rel=1e-3)


def test_the_amplifier_is_a_low_pass_of_first_order() -> None:
    """63.2 % of a step after 1 / (2 pi f)."""
    load, external = np.zeros(6), np.zeros(8)
    load[2] = -QUIET.newton_per_volt
    slow = QUIET.model_copy(update={"filter_hz": 10.0})
    wrist = make_wrist(slow, load, analog(), DT, seed=0)
    for _ in range(round(1 / (2 * np.pi * 10.0) / DT)):
        sense_wrist(wrist, external)
    assert external[6] == pytest.approx(1 - np.exp(-1), abs=5e-3)


def test_offset_and_noise_are_those_of_the_settings() -> None:
    sensor = ForceSensor(channels={"fz": 6}, zero_v=0.2, noise_v=0.01, filter_hz=1e6)
    wrist, external = make_wrist(sensor, np.zeros(6), analog(), DT, seed=3), np.zeros(8)
    volts = []
    for _ in range(2000):
        sense_wrist(wrist, external)
        volts.append(external[6])
    assert np.mean(volts) == pytest.approx(0.2, abs=1e-3)
    assert np.std(volts) == pytest.approx(0.01, rel=0.1)


def test_nothing_wired_moves_no_input() -> None:
    external = np.zeros(8)
    sense_wrist(no_wrist(), external)
    assert not external.any()


def test_the_boards_input_shows_the_sensor_and_a_potentiometers_does_not() -> None:
    emulator = Emulator(ROBOT, scene=TABLE, force_sensor=QUIET)
    board = emulator.bundle.board
    board.analog.external[:] = 1.5
    memory = local_board_memory()
    assert input_volts(board.analog, memory, board.upset.knob, 6) == 1.5
    assert input_volts(board.analog, memory, board.upset.knob, 0) != pytest.approx(1.5, abs=1e-3)


def test_a_channel_with_a_potentiometer_is_refused_with_those_that_are_free() -> None:
    with pytest.raises(ConfigError, match=r"channel 2: it carries the potentiometer of joint 3; free are \[6, 7\]"):
        Emulator(ROBOT, force_sensor=ForceSensor(channels={"fz": 2}))


def test_an_arm_without_potentiometers_has_room_for_all_six_components() -> None:
    wired = ForceSensor(channels=dict(zip(("fx", "fy", "fz", "tx", "ty", "tz"), range(6), strict=True)))
    assert Emulator(ROBOT, pots=False, force_sensor=wired).bundle.wrist.axis.tolist() == [0, 1, 2, 3, 4, 5]


def test_physics_without_contact_has_no_force_sensor() -> None:
    with pytest.raises(ConfigError, match="no force sensor: use MuJoCo's"):
        Emulator(ROBOT, physics="rigid", force_sensor=QUIET)


def test_two_components_on_one_channel_are_refused() -> None:
    with pytest.raises(ValidationError, match="the same channel"):
        ForceSensor(channels={"fx": 6, "fz": 6})
