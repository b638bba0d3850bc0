"""The mismatched plant of the paper's experiment, identified: motors that give a fifth too much or too little."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.config import Robot, load_robot
from qrobot.config.identified import with_model
from qrobot.ident.base import base_of_robot
from qrobot.ident.model import Identified
from qrobot.ident.plan import make_plan
from qrobot.ident.regressor import gravity_regressor
from qrobot.ident.result import model_of
from qrobot.ident.session import identify_log
from qrobot.rig.experiment import program_path, run_program
from qrobot.rig.identify import record_lockstep
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.modes import Mode
from qrobot.servo.settings import ServoSettings
from qrobot.servo.telemetry import Rows
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.mismatch import PlantMismatch

PUMA = load_robot("puma560")
WRONG = PlantMismatch.mismatched(PUMA.n)
SETTINGS = ServoSettings(rate_hz=1000.0)
SHOULDER, ELBOW = 1, 2


@pytest.fixture(scope="module")
def recorded() -> Rows:
    regressor = gravity_regressor(PUMA)
    plan = make_plan(PUMA, regressor, base_of_robot(PUMA, regressor), 12)
    return record_lockstep(PUMA, "puma560", SETTINGS, Emulator(PUMA, mismatch=WRONG), plan)


@pytest.fixture(scope="module")
def found(recorded: Rows) -> Identified:
    return identify_log(PUMA, recorded, 0.001)


def test_shoulder_and_elbow_are_told_apart(found: Identified) -> None:
    true = WRONG.torque_gain[SHOULDER] / WRONG.torque_gain[ELBOW]
    assert found.scale[ELBOW] / found.scale[SHOULDER] == pytest.approx(true, rel=0.01)


def test_torques_are_predicted_on_every_joint(found: Identified) -> None:
    assert (found.held_back_rms < 0.35 * found.before_rms).all()


def largest_error(believed: Robot, law: str) -> np.ndarray:
    """Of the paper's experiment, rad. Shape (n,)."""
    rig = LockstepRig(believed, ServoSettings(rate_hz=1000.0, law=law), Emulator(PUMA, mismatch=WRONG))
    run_program(rig, program_path())
    rows = rig.rows()
    tracked = rows[rows["mode"] == Mode.TRACKING]
    return np.abs(tracked["q_ref"] - tracked["q"]).max(axis=0)


@pytest.mark.parametrize("law", ["qrobot", "qrobot+a"])
def test_the_paper_s_experiment_goes_twice_as_well_and_nearly_as_well_as_with_the_truth(
    found: Identified, recorded: Rows, law: str
) -> None:
    identified = with_model(PUMA, model_of(found, recorded, "2026-11-21"))
    before, after, exact = (largest_error(robot, law) for robot in (PUMA, identified, WRONG.told(PUMA)))
    assert np.linalg.norm(after) < 0.5 * np.linalg.norm(before)
    assert np.linalg.norm(after) < 1.3 * np.linalg.norm(exact)
