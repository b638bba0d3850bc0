"""Force and torque at the wrist: a calibration of volts, and NaN wherever it is not known."""

from __future__ import annotations

import math
from itertools import cycle
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from qrobot.cli.servo_settings import force_calibration_of
from qrobot.config.deployment import DeployedArm, load_deployment
from qrobot.config.force_calibration import ForceCalibration, calibration_of_emulated
from qrobot.config.scene import FORCE_AXES, ForceSensor, Scene
from qrobot.errors import ConfigError, QRobotError
from qrobot.modecodes import Mode
from qrobot.rccl.c.variables import ADC_NONE, reading
from qrobot.rccl_bridge.mailbox_port import MailboxPort
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.kernels.wrench import measure_wrench, wrench_params
from qrobot.servo.operator.force_zero import zero_force
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.wire import State
from qrobot.wire.codec import decode, encode
from tests.support.pressing import ROBOT, tip_down
from tests.support.servo_bench import ServoBench

GRAVITY = 9.81
TABLE = Scene(kind="table")
ALL_SIX = ForceSensor(channels={axis: k for k, axis in enumerate(FORCE_AXES)}, noise_v=0.0, zero_v=0.25)
EVERY = np.ones(8, dtype=np.int64)


def measured(calibration: ForceCalibration | None, volts, done=EVERY, seen=True) -> np.ndarray:
    wrench = np.zeros(6)
    params = wrench_params(calibration)
    measure_wrench(params.matrix, params.bias, np.array(volts), np.array(done), seen, wrench)
    return wrench


coefficients = st.lists(st.floats(-100, 100).map(lambda x: round(x, 3)), min_size=48, max_size=48)
readings = st.lists(st.floats(-10, 10), min_size=8, max_size=8)


@given(coefficients, readings, readings, st.permutations(range(8)))
def test_the_wrench_is_the_matrix_times_the_volts_above_their_bias(numbers, volts, bias, channels) -> None:
    matrix = np.array(numbers).reshape(6, 8)
    calibration = ForceCalibration(channels=tuple(channels), matrix=tuple(map(tuple, matrix)), bias_v=tuple(bias))
    expected = matrix @ (np.array(volts)[list(channels)] - np.array(bias))
    expected[~matrix.any(axis=1)] = math.nan
    np.testing.assert_allclose(measured(calibration, volts), expected, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("channel", range(8))
@pytest.mark.parametrize("why", ["volts", "done"])
def test_a_channel_without_a_value_takes_exactly_those_components_away_that_need_it(channel: int, why: str) -> None:
    matrix = np.random.default_rng(channel).integers(0, 2, (6, 8)).astype(float)
    calibration = ForceCalibration(channels=tuple(range(8)), matrix=tuple(map(tuple, matrix)))
    volts, done = np.ones(8), EVERY.copy()
    if why == "volts":
        volts[channel] = math.nan
    else:
        done[channel] = 0
    unknown = (matrix[:, channel] != 0) | ~matrix.any(axis=1)
    assert np.isnan(measured(calibration, volts, done)).tolist() == unknown.tolist()


def test_nothing_is_known_without_a_sensor_or_without_a_board() -> None:
    assert np.isnan(measured(None, np.ones(8))).all()
    assert np.isnan(measured(calibration_of_emulated(ALL_SIX), np.ones(8), seen=False)).all()


def test_a_servo_without_a_sensor_tells_nan_on_the_wire_and_in_c() -> None:
    bench = ServoBench().tick(3)
    sent = State(1, MailboxPort(bench.mailbox.words).read_state())
    heard = decode(encode(sent))
    assert isinstance(heard, State)
    assert [math.isnan(x) for x in heard.robot.force] == [True] * 6
    assert reading(heard.robot.force[0]) == ADC_NONE


@pytest.mark.parametrize(
    ("value", "shown"), [(0.0, 0), (1.2345, 1234), (-20.0, -20_000), (math.inf, 2_000_000_000), (math.nan, ADC_NONE)]
)
def test_c_programs_read_thousandths(value: float, shown: int) -> None:
    assert reading(value) == shown


def held(**settings: object) -> LockstepRig:
    """An arm that stands with its tool down, with an emulated sensor of six components."""
    start = tip_down(0.5, 0.1, -0.2, TABLE)
    emulator = Emulator(ROBOT, scene=TABLE, start=start, force_sensor=ALL_SIX, pots=False)
    return LockstepRig(ROBOT, ServoSettings(**settings), emulator)  # type: ignore[arg-type]


def test_the_emulated_sensor_reaches_state_and_log_in_newtons() -> None:
    """With the tool pointing down its weight pulls the flange along its z, and turns nothing."""
    rig = held(force_sensor=calibration_of_emulated(ALL_SIX))
    rig.run_for(0.5)
    state = MailboxPort(rig.mailbox.words).read_state()
    step = 10.0 * ALL_SIX.newton_per_volt / 2048  # of the converter
    weight = TABLE.tool.mass_kg * GRAVITY
    assert state.force[:3] == pytest.approx((0.0, 0.0, weight), abs=2 * step)
    assert state.force[3:] == pytest.approx((0.0, 0.0, 0.0), abs=0.2 * step)
    row = rig.rows()[-1]
    assert row["force"].tolist() == list(state.force)
    expected = 0.25 + np.array([0.0, 0.0, weight, 0.0, 0.0, 0.0]) / ALL_SIX.newton_per_volt
    np.testing.assert_allclose(row["volts"][:6], expected, atol=0.02)


def test_a_sensor_is_unknown_before_its_first_conversion_and_when_the_board_is_gone() -> None:
    rig = held(force_sensor=calibration_of_emulated(ALL_SIX))
    rig.ticks(1)
    assert all(map(math.isnan, MailboxPort(rig.mailbox.words).read_state().force))
    rig.run_for(0.1)
    known = rig.rows()["force"]
    assert not np.isnan(known[-1]).any()
    first = np.isnan(known).all(axis=1).argmin()
    assert 0 < first < 60  # six channels, two cycles each


def sensing(rig: LockstepRig) -> SimpleNamespace:
    """The rig, as zeroing sees a servo process."""
    state = rig.state
    return SimpleNamespace(settings=rig.settings, mailbox=rig.mailbox, volts=state.sensors, force_zero=state.force_zero)


def test_a_sensor_that_is_zeroed_shows_what_is_added_from_then_on() -> None:
    """The weight of the tool and the sensor's own offset vanish."""
    rig = held(force_sensor=calibration_of_emulated(ALL_SIX))
    rig.run_for(0.3)
    before = np.array(MailboxPort(rig.mailbox.words).read_state().force)
    zero = zero_force(sensing(rig), lambda: rig.ticks(5))
    rig.run_for(0.1)
    after = np.array(MailboxPort(rig.mailbox.words).read_state().force)
    step = 10.0 * ALL_SIX.newton_per_volt / 2048  # of the converter
    assert abs(before[2]) > 4 * step
    np.testing.assert_allclose(after, 0.0, atol=1.5 * step)
    assert list(zero) == list(range(6))
    rig.state.sensors[2] += 1.0
    np.testing.assert_allclose(measured_now(rig)[2] - after[2], ALL_SIX.newton_per_volt, rtol=1e-9)


def measured_now(rig: LockstepRig) -> np.ndarray:
    wrench = np.zeros(6)
    measure_wrench(rig.params.wrench.matrix, rig.state.force_zero, rig.state.sensors, EVERY, True, wrench)
    return wrench


def resting(mode: Mode = Mode.HOLDING, v: float = 0.0, **volts: float) -> SimpleNamespace:
    """A servo process with a volt at each channel but those given, as zeroing sees it."""
    shown = np.array([volts.get(f"channel{k}", 1.0) for k in range(8)])
    return SimpleNamespace(
        settings=ServoSettings(force_sensor=calibration_of_emulated(ALL_SIX)),
        mailbox=SimpleNamespace(snapshot=lambda: SimpleNamespace(mode=mode, v=np.array([0.0, v]))),
        volts=shown,
        force_zero=np.zeros(8),
    )


@pytest.mark.parametrize(
    ("servo", "complaint"),
    [
        (resting(v=-0.06), "the arm moves"),
        (resting(v=math.nan), "the arm moves"),
        (resting(mode=Mode.TRACKING), "not in mode TRACKING"),
        (resting(mode=Mode.STOPPING), "not in mode STOPPING"),
        (resting(channel3=math.nan), "channel 3 of the force sensor shows nan V"),
        (resting(channel0=-9.95), "channel 0 .* no zero: check its cable"),
    ],
)
def test_what_moves_or_shows_no_zero_is_not_zeroed(servo: SimpleNamespace, complaint: str) -> None:
    with pytest.raises(QRobotError, match=complaint):
        zero_force(servo, lambda: None)
    assert not servo.force_zero.any()


def test_an_arm_that_begins_to_move_meanwhile_is_not_zeroed() -> None:
    servo = resting()
    left = iter(range(10))

    def pause() -> None:
        if next(left) == 9:
            servo.mailbox = resting(mode=Mode.TRACKING).mailbox

    with pytest.raises(QRobotError, match="TRACKING"):
        zero_force(servo, pause)
    assert not servo.force_zero.any()


@pytest.mark.parametrize("powered", [False, True])
def test_an_arm_whose_wrist_somebody_turns_is_not_zeroed(powered: bool) -> None:
    """Its reference stands still all the while, with power and without."""
    rig = held(force_sensor=calibration_of_emulated(ALL_SIX))
    rig.mailbox.request_power(powered)
    rig.run_for(0.5)
    assert rig.mailbox.snapshot().mode == (Mode.HOLDING if powered else Mode.OFF)
    rig.board.panel.push[5], before = 3_000_000, rig.state.force_zero.tolist()
    with pytest.raises(QRobotError, match="the arm moves"):
        zero_force(sensing(rig), lambda: rig.ticks(5))
    assert rig.state.force_zero.tolist() == before


@pytest.mark.parametrize(("swing_v", "zeroed"), [(0.08, True), (0.12, False)])
def test_readings_that_swing_are_no_zero(swing_v: float, zeroed: bool) -> None:
    servo = resting()
    swings = cycle((swing_v, -swing_v))

    def pause() -> None:
        servo.volts[4] = 1.0 + next(swings)

    if zeroed:
        assert zero_force(servo, pause)[4] == pytest.approx(1.0, abs=0.01)
        return
    with pytest.raises(QRobotError, match=r"channel 4 of the force sensor scatters by 0\.1\d V about 1 V"):
        zero_force(servo, pause)
    assert not servo.force_zero.any()


def test_a_channel_that_is_no_force_keeps_its_zero() -> None:
    servo = resting()
    assert zero_force(servo, lambda: None) == dict.fromkeys(range(6), 1.0)
    assert servo.force_zero.tolist() == [1.0] * 6 + [0.0] * 2


def arm(board: dict[str, object], servo: dict[str, object]) -> DeployedArm:
    packaged = load_deployment("emulator").arm[0].model_dump()
    return DeployedArm.model_validate(packaged | {"board": board, "servo": servo})


SHEET = {"channels": [6, 7], "matrix": [[1.0, 0.0], [0.0, 0.0], [0.0, 2.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]]}


def test_the_file_comes_first_and_an_emulated_sensor_knows_itself() -> None:
    sensor = {"channels": {"fz": 6}, "newton_per_volt": 5.0}
    assert force_calibration_of(arm({}, {})) is None
    itself = force_calibration_of(arm({"force_sensor": sensor}, {}))
    assert itself is not None
    assert (itself.channels, itself.matrix[2], itself.bias_v) == ((6,), (5.0,), (0.05,))
    given = force_calibration_of(arm({"force_sensor": sensor}, {"force_sensor": SHEET}))
    assert given is not None
    assert given.channels == (6, 7)
    assert ServoSettings(sensor_channels=(5,), force_sensor=given).sampled_channels == {5, 6, 7}


def test_a_channel_that_carries_a_potentiometer_is_refused_with_its_joint() -> None:
    with pytest.raises(ConfigError, match="channel 2 carries the potentiometer of joint 3"):
        force_calibration_of(arm({}, {"force_sensor": SHEET | {"channels": [2, 7]}}))


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"channels": [6, 6]}, "the same channel twice"),
        ({"channels": [6, 8]}, "less than or equal to 7"),
        ({"channels": []}, "at least 1 item"),
        ({"matrix": SHEET["matrix"][:5]}, "matrix"),
        ({"matrix": [[1.0], *SHEET["matrix"][1:]]}, "1 numbers for fx, but 2 channels"),
        ({"matrix": [[math.nan, 0.0], *SHEET["matrix"][1:]]}, "finite"),
        ({"bias_v": [1.0]}, "bias_v: 1 numbers, but 2 channels"),
        ({"bias_v": [1.0, math.inf]}, "finite"),
    ],
)
def test_a_calibration_that_cannot_be_meant_is_refused(change: dict[str, object], complaint: str) -> None:
    with pytest.raises(ValidationError, match=complaint):
        ForceCalibration.model_validate(SHEET | change)
