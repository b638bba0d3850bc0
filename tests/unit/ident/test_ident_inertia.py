"""Inertia from fast motion: an arm's own equations with encoder and converter steps go in, its parameters come out."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.config.identified import load_model, with_model
from qrobot.errors import IdentificationError
from qrobot.hwif.registers import DAC_ZERO
from qrobot.ident.base import BaseParameters, base_of_robot
from qrobot.ident.excitation import RUN_S
from qrobot.ident.fourier import Fourier, States
from qrobot.ident.friction import friction_columns
from qrobot.ident.inertia import InertialModel, identify_inertia
from qrobot.ident.model import Identified, identify
from qrobot.ident.motion import WINDOW_S, MotionRows, observe_motion
from qrobot.ident.physical_inertia import nearest_bodies
from qrobot.ident.regressor import OF_GRAVITY, Regressor, inertial_regressor, known_parameters
from qrobot.ident.result import model_of, write_model
from qrobot.modecodes import Mode
from qrobot.model.dynamics import dynamics_params
from qrobot.servo.memory.telemetry import Rows, TelemetryLayout
from tests.support.observations import LOAD, generated, puma_base

PUMA = load_robot("puma560")
N = PUMA.n
PERIOD_S = 0.001
MOTIONS = 3
FRICTION = np.column_stack(
    [PUMA.friction["corke"].viscous, PUMA.friction["corke"].coulomb_pos, PUMA.friction["corke"].coulomb_neg]
)


@cache
def whole() -> tuple[Regressor, BaseParameters]:
    regressor = inertial_regressor(PUMA)
    return regressor, base_of_robot(PUMA, regressor)


@cache
def theta() -> np.ndarray:
    """An arm of bodies up to 40 % heavier than the robot file's, and of larger ones."""
    random, links = np.random.default_rng(3), PUMA.links
    grown = {"mass": links.mass * random.uniform(1.0, 1.4, N), "inertia": links.inertia * random.uniform(1.5, 2.0)}
    return known_parameters(PUMA.model_copy(update={"links": links.model_copy(update=grown)}), whole()[0])


@cache
def steady(noise: float = 0.02) -> Identified:
    """What slow passes tell of it."""
    regressor, base = puma_base()
    beta = base.K @ theta().reshape(N, -1)[:, :OF_GRAVITY].ravel()
    return identify(PUMA, base, regressor, generated(beta, FRICTION, noise, 1), known_torque=True)


def commanded(states: States) -> np.ndarray:
    """Torque of the motors by the arm's equations. Shape (r, n)."""
    given = whole()[0](*states) @ theta() + states.a @ dynamics_params(PUMA).armature
    rubs = friction_columns(states.v @ PUMA.transmission.coupling.T, PUMA.control.friction_velocity) * FRICTION
    return given @ np.linalg.inv(PUMA.transmission.coupling) + rubs.sum(axis=-1)


def recorded(motion: Fourier) -> Rows:
    """One motion, each torque computed in the middle of its cycle, with whole counts and DAC words."""
    rows = TelemetryLayout(N).empty(round(motion.seconds / PERIOD_S))
    t, coupling = PERIOD_S * np.arange(len(rows)), PUMA.transmission.coupling
    counts = np.rint(motion.at(t).q @ coupling.T / PUMA.transmission.rad_per_count)
    rows["q"] = (counts * PUMA.transmission.rad_per_count) @ np.linalg.inv(coupling).T
    rows["v_ref"], rows["mode"] = motion.at(t).v, Mode.TRACKING
    rows["dac"] = np.rint(commanded(motion.at(t + 0.5 * PERIOD_S)) * PUMA.transmission.dac_per_Nm) + DAC_ZERO
    return rows


@cache
def log() -> Rows:
    """Motions with a rest after each."""
    random, parts = np.random.default_rng(5), []
    for _ in range(MOTIONS):
        sine, cosine = random.normal(size=(2, N, 5)) / np.arange(1.0, 6.0)
        unit = Fourier.from_rest(PUMA.poses["ready"], sine, cosine, RUN_S)
        speed = np.abs(unit.at(np.linspace(0.0, RUN_S, 200)).v).max(axis=0)
        run = recorded(unit.scaled(0.5 * PUMA.limits.v_max / speed))
        still = np.repeat(run[-1:], 200)
        still["v_ref"] = 0.0
        parts += [run, still]
    rows = np.concatenate(parts)
    rows["tick"] = np.arange(len(rows))
    return rows


@cache
def observed() -> MotionRows:
    return observe_motion(PUMA, *whole(), log(), PERIOD_S)


@cache
def found() -> InertialModel:
    return identify_inertia(steady(), *whole(), observed())


def test_every_motion_is_found_and_windows_in_which_a_motor_creeps_are_left_out() -> None:
    assert np.unique(observed().motion).tolist() == list(range(MOTIONS))
    assert (np.abs(observed().rate) >= 0.06 * PUMA.limits.v_max[observed().motor]).all()
    assert 0.3 < len(observed()) / (MOTIONS * N * RUN_S / WINDOW_S) < 0.95


def test_the_equations_hold_for_the_true_parameters() -> None:
    seen, (_, base) = observed(), whole()
    rubs = steady().unknowns.friction_jacobian(seen.motor, seen.rate) @ FRICTION.ravel()
    left = seen.torque - seen.rotors - rubs - seen.columns @ (base.K @ theta())
    by_motor = [float(np.sqrt(np.mean(left[seen.motor == j] ** 2))) for j in range(N)]
    assert (np.array(by_motor) < 0.004 * PUMA.guard.tau_max).all()


def test_a_torque_at_its_limit_and_a_lost_row_spoil_their_windows_only() -> None:
    spoilt = log().copy()
    spoilt["dac"][4000, 0] = 4095
    fewer = observe_motion(PUMA, *whole(), spoilt, PERIOD_S)
    assert 1 <= len(observed()) - len(fewer) <= N


def test_inertia_comes_back_with_honest_intervals() -> None:
    base, beta = whole()[1], whole()[1].K @ theta()
    off, inertias = np.abs(found().beta - beta), [name.startswith("I") for name in base.leaders]
    assert np.mean(off < found().fit.half_width[: len(beta)]) > 0.8
    before = np.abs(base.K @ known_parameters(PUMA, whole()[0]) - beta)
    assert np.linalg.norm(off[inertias]) < 0.1 * np.linalg.norm(before[inertias])


def test_held_back_motion_is_predicted_better_than_with_the_files_inertia() -> None:
    heavy = slice(0, 3)
    assert (found().held_back_rms[heavy] < 0.5 * found().before_rms[heavy]).all()
    assert (found().held_back_rms < 1.1 * found().before_rms).all()


def test_values_are_named_once_with_units_and_what_the_file_says() -> None:
    values = {value.name: value for value in found().values}
    assert len(values) == len(found().values) == 36 + (3 + 2 + 1) * N
    assert (values["Izz1"].unit, values["hx2"].unit, values["elbow.viscous"].unit) == ("kg m2", "kg m", "N m/(rad/s)")
    assert values["Izz1"].before == pytest.approx((whole()[1].K @ known_parameters(PUMA, whole()[0]))[0])


def test_the_servo_gets_the_inertia_by_the_models_file(tmp_path: Path) -> None:
    model = model_of(steady(), log(), "2026-11-21", found())
    write_model(tmp_path / "model.toml", model)
    robot = with_model(PUMA, load_model(tmp_path / "model.toml", PUMA))
    np.testing.assert_allclose(robot.links.inertia, found().links.inertia, atol=1e-7)
    regressor, base = whole()
    beta = base.K @ known_parameters(robot, regressor)
    true, before = base.K @ theta(), base.K @ known_parameters(PUMA, regressor)
    assert np.linalg.norm(beta - true) < 0.15 * np.linalg.norm(before - true)


def test_bodies_of_the_files_own_parameters_are_the_files() -> None:
    regressor, base = whole()
    links = nearest_bodies(PUMA, base, base.K @ known_parameters(PUMA, regressor), 1e-8 * np.eye(len(base.leading)))
    np.testing.assert_allclose(links.mass, PUMA.links.mass, rtol=1e-4)
    np.testing.assert_allclose(links.inertia, PUMA.links.inertia, atol=1e-5)


def test_bodies_exist_even_where_what_was_found_is_none() -> None:
    regressor, base = whole()
    beta = base.K @ known_parameters(PUMA, regressor)
    beta[[base.leaders.index(name) for name in ("Izz4", "Izz6", "Izz3")]] -= 0.01  # noise larger than a wrist
    links = nearest_bodies(PUMA, base, beta, 1e-4 * np.eye(len(beta)))
    assert (links.mass > 0.0).all()
    assert (2.0 * links.inertia.max(axis=1) < links.inertia.sum(axis=1)).all()


@pytest.mark.parametrize("times", [1.05, 1.2, 1.49, 2.0])
def test_a_model_that_predicts_fast_motion_worse_is_refused(times: float) -> None:
    worse = replace(found(), held_back_rms=np.full(N, 2.0 * times), before_rms=np.full(N, 2.0))
    with pytest.raises(IdentificationError, match=r"predicts waist, shoulder.*no model is written"):
        model_of(steady(), log(), "2026-11-21", worse)


def test_a_model_whose_error_in_fast_motion_is_larger_by_less_than_can_be_commanded_is_written() -> None:
    before, step = np.full(N, 2.0), 1.0 / np.abs(PUMA.transmission.dac_per_Nm)
    as_good = replace(found(), held_back_rms=before + 0.45 * step, before_rms=before)
    assert model_of(steady(), log(), "2026-11-21", as_good).quality.motion_rms is not None


def test_too_little_motion_is_refused() -> None:
    seen = observed()
    with pytest.raises(IdentificationError, match="2 motions recorded, 3 are needed"):
        identify_inertia(steady(), *whole(), seen.only(seen.motion < 2))
    with pytest.raises(IdentificationError, match="no motion turns flange fast enough"):
        identify_inertia(steady(), *whole(), seen.only(seen.motor < N - 1))
    with pytest.raises(IdentificationError, match="nothing recorded moves for long"):
        observe_motion(PUMA, *whole(), log()[:2000], PERIOD_S)


def with_torque(change: np.ndarray) -> MotionRows:
    return replace(observed(), torque=observed().torque + change)


def other_gravity(change: np.ndarray) -> np.ndarray:
    """Torque of rows for other link parameters, shape (p,) of the inertial regressor."""
    return observed().columns @ (whole()[1].K @ change)


@pytest.mark.parametrize("load_kg", [0.5, -0.3, 2.0])
def test_fast_motion_with_another_load_is_refused(load_kg: float) -> None:
    change = np.zeros((N, theta().size // N))
    change[-1, :OF_GRAVITY] = load_kg * LOAD
    with pytest.raises(IdentificationError, match=r"another gravity than the steady passes on .*shoulder"):
        identify_inertia(steady(), *whole(), with_torque(other_gravity(change.ravel())))


def test_fast_motion_of_another_arm_is_refused() -> None:
    random = np.random.default_rng(8)
    change = theta() * random.uniform(-0.3, 0.3, theta().size)
    with pytest.raises(IdentificationError, match="Is it a log of another arm"):
        identify_inertia(steady(), *whole(), with_torque(other_gravity(change)))


def test_fast_motion_of_the_same_arm_with_warmer_drives_is_taken() -> None:
    seen = observed()
    warmer = -0.1 * (steady().unknowns.friction_jacobian(seen.motor, seen.rate) @ FRICTION.ravel())
    identify_inertia(steady(), *whole(), with_torque(warmer))
