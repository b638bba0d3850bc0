"""Runs for inertia: smooth from rest to rest, informative, within all limits, clear, and always the same."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.config.robot import robot_path
from qrobot.errors import IdentificationError
from qrobot.ident.base import BaseParameters, base_of_robot
from qrobot.ident.clearance import Clearance
from qrobot.ident.excitation import FEWEST, RUN_S, RUNS, Excitation, expected_torque, make_excitation
from qrobot.ident.fourier import Fourier
from qrobot.ident.perform import setpoints_of
from qrobot.ident.regressor import Regressor, inertial_regressor
from qrobot.motion import motion_limits

PUMA = load_robot("puma560")
N = PUMA.n
READY = "ready = [0, -90, 90, 0, 0, 0]"


@cache
def regressor_and_base(name: str = "puma560") -> tuple[Regressor, BaseParameters]:
    robot = load_robot(name)
    regressor = inertial_regressor(robot)
    return regressor, base_of_robot(robot, regressor)


@cache
def excitation(seed: int = 0, name: str = "puma560") -> Excitation:
    return make_excitation(load_robot(name), *regressor_and_base(name), FEWEST, seed)


def any_motion(seed: int = 1) -> Fourier:
    sine, cosine = np.random.default_rng(seed).normal(size=(2, N, 4))
    return Fourier.from_rest(np.arange(N) / 10.0, sine, cosine, 5.0)


def test_velocity_and_acceleration_are_the_derivatives_of_position() -> None:
    motion, t, h = any_motion(), np.linspace(0.3, 4.7, 9), 1e-4
    (q, v, a), (after, _, _), (before, _, _) = motion.at(t), motion.at(t + h), motion.at(t - h)
    np.testing.assert_allclose(v, (after - before) / (2.0 * h), atol=1e-5)
    np.testing.assert_allclose(a, (after - 2.0 * q + before) / h**2, atol=1e-4)


def test_a_motion_begins_and_ends_at_rest_in_the_same_place() -> None:
    motion = any_motion()
    q, v, a = motion.at(np.array([0.0, motion.seconds]))
    np.testing.assert_allclose(q, np.tile(motion.start, (2, 1)), atol=1e-12)
    np.testing.assert_allclose([v, a], 0.0, atol=1e-11)


def test_a_motion_that_rests_already_is_its_own_nearest() -> None:
    motion = any_motion()
    again = Fourier.from_rest(motion.centre, motion.sine, motion.cosine, motion.seconds)
    np.testing.assert_allclose([again.sine, again.cosine], [motion.sine, motion.cosine], atol=1e-14)


def test_runs_stay_within_range_speed_acceleration_and_torque() -> None:
    limits, t = PUMA.limits, np.linspace(0.0, RUN_S, 1601)
    for run in excitation().runs:
        states = run.motion.at(t)
        assert ((states.q > limits.q_min) & (states.q < limits.q_max)).all()
        assert (np.abs(states.v) < 0.75 * limits.v_max).all()
        assert (np.abs(states.a) < 0.75 * limits.a_max).all()
        torque = expected_torque(PUMA, regressor_and_base()[0], states)
        assert (np.abs(torque) < 0.65 * PUMA.guard.tau_max).all()


def test_every_run_is_clear_all_along_and_so_is_the_way_to_it() -> None:
    clearance, at = Clearance(PUMA), PUMA.poses["ready"]
    for run in excitation().runs:
        stops = [at, PUMA.poses["ready"], run.motion.start] if run.by_ready else [at, run.motion.start]
        assert all(clearance.of_way(begin, end) for begin, end in pairwise(stops))
        assert all(map(clearance.of_pose, run.motion.at(np.linspace(0.0, RUN_S, 400)).q))
        at = run.motion.start


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "seeds"), [("puma560", 2), ("stanford", 1)])
def test_the_way_between_ready_and_every_run_is_clear(name: str, seeds: int) -> None:
    """The first run is gone to from there, any by --first N, and the arm goes back there after the last."""
    robot = load_robot(name)
    for seed in range(seeds):
        runs = excitation(seed, name).runs
        assert all(Clearance(robot).of_way(robot.poses["ready"], run.motion.start) for run in runs), seed


def test_a_run_that_no_clear_way_leads_to_is_not_made(tmp_path: Path) -> None:
    """An arm waits folded, its hand bent: half a turn of the wrist would lead the hand through the upper arm."""
    path = tmp_path / "puma560.toml"
    path.write_text(robot_path("puma560").read_text().replace(READY, "ready = [0, -90, 240, -90, 100, 0]"))
    robot = load_robot(path)
    clearance, ready, regressor = Clearance(robot), robot.poses["ready"], inertial_regressor(robot)
    runs = make_excitation(robot, regressor, base_of_robot(robot, regressor), RUNS, seed=2).runs
    assert all(clearance.of_way(ready, run.motion.start) for run in runs)


def test_runs_are_setpoints_that_an_arm_accepts() -> None:
    for run in excitation().runs:
        setpoints = setpoints_of(PUMA, run)
        setpoints.check(motion_limits(PUMA), run.name)
        np.testing.assert_allclose(setpoints.q[[0, -1]], np.tile(run.motion.start, (2, 1)), atol=1e-9)


def test_chosen_runs_tell_all_36_parameters_of_a_puma_apart_and_random_ones_worse() -> None:
    regressor, base = regressor_and_base()
    random = [any_motion(seed).scaled(0.1) for seed in range(FEWEST)]
    Y = np.concatenate([regressor(*motion.at(np.linspace(0.0, 5.0, 65))) for motion in random])
    columns = base.columns(Y).reshape(-1, len(base.leading))
    at_random = np.linalg.cond(columns / np.linalg.norm(columns, axis=0))
    assert excitation().condition < 10.0 < at_random


@pytest.mark.thorough
def test_the_same_seed_gives_the_same_runs_and_another_seed_others() -> None:
    again = make_excitation(PUMA, *regressor_and_base(), FEWEST)
    assert again.to_dict() == excitation().to_dict()
    assert excitation(1).to_dict() != again.to_dict()


def test_too_few_runs_are_refused() -> None:
    with pytest.raises(IdentificationError, match="2 runs are too few: at least 3, of which one is held back"):
        make_excitation(PUMA, *regressor_and_base(), 2)
