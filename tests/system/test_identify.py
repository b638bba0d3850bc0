"""Identification in lock-step, from a plan to a servo that knows better, on an arm nobody has told it of.

Mass, centre and friction of the plant are drawn at random within 30 % of the robot file, and something is in its hand.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.config import Robot, load_robot
from qrobot.config.identified import load_model, with_model
from qrobot.ident.base import base_of_robot
from qrobot.ident.plan import make_plan
from qrobot.ident.regressor import gravity_regressor, known_parameters
from qrobot.log.header import header_for
from qrobot.log.record import write_log
from qrobot.modecodes import Mode
from qrobot.rig.experiment import program_path, run_program
from qrobot.rig.identify import record_lockstep
from qrobot.rig.lockstep import LockstepRig
from qrobot.rig.perturbed_arm import PerturbedArm
from qrobot.servo.memory.telemetry import Rows
from qrobot.servo.settings import ServoSettings

PUMA = load_robot("puma560")
N = PUMA.n
POSES = 12
SETTINGS = ServoSettings(rate_hz=500.0)
LAW_JOINTS = slice(1, 3)  # those whose gravity a PUMA's law has always compensated


UNKNOWN = PerturbedArm.drawn(PUMA, seed=1)


@pytest.fixture(scope="module")
def recorded() -> Rows:
    regressor = gravity_regressor(PUMA)
    plan = make_plan(PUMA, regressor, base_of_robot(PUMA, regressor), POSES)
    rows = record_lockstep(PUMA, "puma560", SETTINGS, UNKNOWN.emulator(), plan)
    assert not rows["fault"].any()
    return rows


@pytest.fixture(scope="module")
def model_file(recorded: Rows, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `qrobot identify fit` makes of the log."""
    folder = tmp_path_factory.mktemp("identify")
    log, model = folder / "run.mcap", folder / "model.toml"
    write_log(log, recorded, header_for(PUMA, SETTINGS.period_ns, SETTINGS.law))
    command = ["identify", "fit", str(log), "--output", str(model), "--date", "2026-11-21"]
    assert run_app(make_app(), command) == 0
    return model


@pytest.fixture(scope="module")
def identified(model_file: Path) -> Robot:
    return with_model(PUMA, load_model(model_file, PUMA))


def gravity_error(robot: Robot, truth: PerturbedArm) -> np.ndarray:
    """Rms over poses the arm never took, N m. Shape (n,)."""
    q = np.random.default_rng(99).uniform(PUMA.limits.q_min, PUMA.limits.q_max, (500, N))
    regressor = gravity_regressor(PUMA)
    return np.sqrt(
        np.mean(
            (regressor(q) @ known_parameters(robot, regressor) - regressor(q) @ truth.parameters(regressor)) ** 2,
            axis=0,
        )
    )


def test_gravity_is_found_to_hundredths_of_a_newton_metre(identified: Robot) -> None:
    error = gravity_error(identified, UNKNOWN)
    assert (error[LAW_JOINTS] < 0.02).all()
    assert (error[3:] < 0.005).all()
    assert (gravity_error(PUMA, UNKNOWN)[LAW_JOINTS] > 2.0).all()


def test_intervals_hold_the_truth(model_file: Path) -> None:
    regressor = gravity_regressor(PUMA)
    beta = base_of_robot(PUMA, regressor).K @ UNKNOWN.parameters(regressor)
    found = load_model(model_file, PUMA).value
    truth = [*beta, *UNKNOWN.friction.ravel(), *np.ones(N - 1), *np.zeros(3 * N)]
    assert (
        np.mean([abs(value.value - true) <= value.half_width for value, true in zip(found, truth, strict=True)]) > 0.9
    )


def test_friction_is_found_within_a_fiftieth(model_file: Path) -> None:
    preset = load_model(model_file, PUMA).friction
    found = np.column_stack([preset.viscous, preset.coulomb_pos, preset.coulomb_neg])
    np.testing.assert_allclose(found, UNKNOWN.friction, rtol=0.02)


def test_the_load_in_the_hand_is_put_there(identified: Robot) -> None:
    wrist = slice(3, None)
    true = UNKNOWN.robot.links.mass[wrist].sum() + UNKNOWN.payload_kg
    assert identified.links.mass[wrist].sum() == pytest.approx(true, abs=0.4)


def test_the_model_says_how_well_it_predicts(model_file: Path) -> None:
    quality = load_model(model_file, PUMA).quality
    assert (quality.held_back_rms < 0.3 * quality.before_rms).all()


def tracking_error(believed: Robot, truth: PerturbedArm) -> np.ndarray:
    """Rms of the paper's experiment, rad. Shape (n,)."""
    rig = LockstepRig(believed, SETTINGS, truth.emulator())
    run_program(rig, program_path())
    rows = rig.rows()
    tracked = rows[rows["mode"] == Mode.TRACKING]
    return np.sqrt(np.mean((tracked["q_ref"] - tracked["q"]) ** 2, axis=0))


def test_the_servo_tracks_twice_as_well_with_the_model_and_nearly_as_well_as_with_the_truth(identified: Robot) -> None:
    before, after, exact = (
        np.linalg.norm(tracking_error(robot, UNKNOWN)) for robot in (PUMA, identified, UNKNOWN.told)
    )
    assert after < 0.5 * before
    assert after < 1.3 * exact
