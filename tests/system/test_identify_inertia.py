"""Inertia in lock-step: an arm nobody knows makes the runs of its plan, and its inertia is in the servo's model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.config.identified import load_model, with_model
from qrobot.ident.base import base_of_robot
from qrobot.ident.compact_recording import load_recording
from qrobot.ident.excitation import FEWEST, make_excitation
from qrobot.ident.regressor import inertial_regressor, known_parameters
from qrobot.log.header import header_for
from qrobot.log.record import write_log
from qrobot.rig.identify import record_lockstep
from qrobot.rig.perturbed_arm import PerturbedArm
from qrobot.servo.settings import ServoSettings

SHIPPED = load_recording("unknown_arm")
PUMA = SHIPPED.robot
ARM = PerturbedArm.drawn(PUMA, seed=7)  # `docs/unknown_arm.py`
SETTINGS = ServoSettings(rate_hz=250.0)
HEAVY = slice(0, 3)


@pytest.fixture(scope="module")
def model_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `qrobot identify fit --dynamic` makes of the shipped steady passes and of runs of the same arm."""
    folder, regressor = tmp_path_factory.mktemp("inertia"), inertial_regressor(PUMA)
    runs = make_excitation(PUMA, regressor, base_of_robot(PUMA, regressor), FEWEST)
    fast = record_lockstep(PUMA, "puma560", SETTINGS, ARM.emulator(), runs)
    assert not fast["fault"].any()
    header = header_for(PUMA, SETTINGS.period_ns, SETTINGS.law)
    logs = [write_log(folder / "slow.mcap", SHIPPED.rows, header)[0], write_log(folder / "fast.mcap", fast, header)[0]]
    command = ["identify", "fit", str(logs[0]), "--dynamic", str(logs[1]), "--output", str(folder / "model.toml")]
    assert run_app(make_app(), [*command, "--known-torque", "--date", "2026-11-21"]) == 0
    return folder / "model.toml"


def test_the_arm_that_moves_fast_is_the_one_of_the_steady_passes() -> None:
    np.testing.assert_allclose(ARM.friction, SHIPPED.facts["friction"])


@pytest.mark.thorough
def test_fast_motion_is_predicted_several_times_better_than_with_the_files_inertia(model_file: Path) -> None:
    quality = load_model(model_file, PUMA).quality
    assert quality.motion_rms is not None
    assert quality.motion_before_rms is not None
    assert (quality.motion_rms[HEAVY] < 0.5 * quality.motion_before_rms[HEAVY]).all()


@pytest.mark.thorough
def test_the_servos_links_have_the_inertia_of_the_arm(model_file: Path) -> None:
    regressor = inertial_regressor(PUMA)
    base, believed = base_of_robot(PUMA, regressor), with_model(PUMA, load_model(model_file, PUMA))
    true = base.K @ known_parameters(ARM.told, regressor)
    found, file = (base.K @ known_parameters(robot, regressor) for robot in (believed, PUMA))
    assert np.linalg.norm(found - true) < 0.15 * np.linalg.norm(file - true)


def test_the_plan_is_shown_and_nothing_moves(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_app(make_app(), ["identify", "plan", "--dynamic"]) == 0
    said = capsys.readouterr().out
    assert "run 4" in said
    assert "Izz1" in said
    assert "inertia and gravity" in said
