"""The mismatched plant of the paper's experiment, identified: motors that give a fifth too much or too little."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from qrobot.cli.console import run_app
from qrobot.cli.identify_fit import friction_table
from qrobot.cli.main import make_app
from qrobot.config import Robot, load_robot
from qrobot.config.identified import with_model
from qrobot.ident.base import base_of_robot
from qrobot.ident.model import Identified
from qrobot.ident.plan import make_plan
from qrobot.ident.regressor import gravity_regressor
from qrobot.ident.result import model_of
from qrobot.ident.session import identify_log
from qrobot.ident.stribeck import friction_of
from qrobot.log.header import header_for
from qrobot.log.record import write_log
from qrobot.modecodes import Mode
from qrobot.rig.experiment import program_path, run_program
from qrobot.rig.identify import record_lockstep
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.memory.telemetry import Rows
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.drive import STRIBECK_FRACTION
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.mismatch import PlantMismatch

PUMA = load_robot("puma560")
WRONG = PlantMismatch.mismatched(PUMA.n)
SETTINGS = ServoSettings(rate_hz=1000.0)
SHOULDER, ELBOW = 1, 2


@pytest.fixture(scope="module")
def recorded() -> Rows:
    regressor = gravity_regressor(PUMA)
    plan = make_plan(PUMA, regressor, base_of_robot(PUMA, regressor), 12, slow=True)
    return record_lockstep(PUMA, "puma560", SETTINGS, Emulator(PUMA, mismatch=WRONG), plan)


@pytest.fixture(scope="module")
def found(recorded: Rows) -> Identified:
    return identify_log(PUMA, recorded, 0.001)


def test_shoulder_and_elbow_are_told_apart(found: Identified) -> None:
    true = WRONG.torque_gain[SHOULDER] / WRONG.torque_gain[ELBOW]
    assert found.scale[ELBOW] / found.scale[SHOULDER] == pytest.approx(true, rel=0.01)


def test_torques_are_predicted_on_every_joint(found: Identified) -> None:
    assert (found.held_back_rms < 0.35 * found.before_rms).all()


def test_friction_that_falls_with_speed_is_found_without_bending_the_rest(found: Identified, recorded: Rows) -> None:
    fitted, preset = friction_of(found, recorded, 0.001), PUMA.friction["corke"]
    viscous = preset.viscous * WRONG.viscous / WRONG.torque_gain
    coulomb = np.column_stack([preset.coulomb_pos * WRONG.coulomb_pos, preset.coulomb_neg * WRONG.coulomb_neg])
    coulomb /= WRONG.torque_gain[:, None]
    np.testing.assert_allclose(fitted.viscous, viscous, rtol=0.01)
    np.testing.assert_allclose(fitted.coulomb, coulomb, rtol=0.01)
    np.testing.assert_allclose(found.friction, np.column_stack([viscous, coulomb]), rtol=0.01)
    assert found.sticking == PUMA.joint_names
    np.testing.assert_allclose(fitted.excess, (WRONG.stiction - 1.0) * coulomb, rtol=0.3)
    assert friction_table(PUMA, fitted).row_count == 6 * PUMA.n
    np.testing.assert_allclose(fitted.speed, STRIBECK_FRACTION * PUMA.limits.v_max, rtol=0.1)


def test_friction_and_report_come_from_the_command_line(
    recorded: Rows, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, page = tmp_path / "run.mcap", tmp_path / "report.html"
    rows = recorded[::4].copy()  # a log of a slower servo is as good, and sooner read
    rows["tick"] //= 4
    write_log(log, rows, header_for(PUMA, 4 * SETTINGS.period_ns, SETTINGS.law))
    assert run_app(make_app(), ["identify", "friction", str(log), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["motors"] == list(PUMA.joint_names)
    assert run_app(make_app(), ["identify", "report", str(log), "--output", str(page)]) == 0
    assert "elbow.torque_scale" in page.read_text()
    assert "is more near standstill than any law compensates" in page.read_text()


def largest_error(believed: Robot, law: str) -> np.ndarray:
    """Of the paper's experiment, rad. Shape (n,)."""
    rig = LockstepRig(believed, ServoSettings(rate_hz=1000.0, law=law), Emulator(PUMA, mismatch=WRONG))
    run_program(rig, program_path())
    rows = rig.rows()
    tracked = rows[rows["mode"] == Mode.TRACKING]
    return np.abs(tracked["q_ref"] - tracked["q"]).max(axis=0)


@pytest.mark.thorough
@pytest.mark.parametrize("law", ["qrobot", "qrobot+a"])
def test_the_paper_s_experiment_goes_twice_as_well_and_nearly_as_well_as_with_the_truth(
    found: Identified, recorded: Rows, law: str
) -> None:
    identified = with_model(PUMA, model_of(found, recorded, "2026-11-21"))
    before, after, exact = (largest_error(robot, law) for robot in (PUMA, identified, WRONG.told(PUMA)))
    assert np.linalg.norm(after) < 0.5 * np.linalg.norm(before)
    assert np.linalg.norm(after) < 1.3 * np.linalg.norm(exact)
