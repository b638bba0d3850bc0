"""The plan of an identification: informative, within all limits, clear of floor and arm, and always the same."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from qrobot.config import Robot, load_robot
from qrobot.config.robot import robot_path
from qrobot.errors import IdentificationError
from qrobot.ident.base import BaseParameters, base_of_robot
from qrobot.ident.clearance import Clearance
from qrobot.ident.excitation import RUN_S, RUNS
from qrobot.ident.plan import PASS_S, ExcitationPlan, _sweeps, choose_informative, make_plan
from qrobot.ident.regressor import Regressor, gravity_regressor

NAMES = ("puma560", "stanford")
ROBOTS = pytest.mark.parametrize("name", NAMES)
PUMA = load_robot("puma560")


@cache
def base(name: str) -> tuple[Robot, Regressor, BaseParameters]:
    robot = load_robot(name)
    regressor = gravity_regressor(robot)
    return robot, regressor, base_of_robot(robot, regressor)


@cache
def plan(name: str, seed: int = 0) -> ExcitationPlan:
    return make_plan(*base(name), poses=12, seed=seed)


@cache
def whole_plan(name: str, seed: int = 0) -> ExcitationPlan:
    """With as many poses as one has, and slow sweeps."""
    return make_plan(*base(name), seed=seed, slow=True)


@ROBOTS
def test_a_plan_stays_within_range_speed_and_acceleration(name: str) -> None:
    limits = load_robot(name).limits
    for swing in plan(name).swings:
        assert ((limits.q_min < swing.low) & (swing.high < limits.q_max)).all()
        speed = 2.0 * swing.half / swing.seconds
        assert (speed <= 0.75 * limits.v_max).all()
        assert (1.5 * speed / swing.turn_s <= limits.a_max).all()  # Paul's transition turns it round in 2 turn_s
        assert swing.seconds - 2.0 * swing.turn_s == pytest.approx(PASS_S)


def with_range(name: str, joint: int, share: float) -> Robot:
    """A robot with a share of the range of one joint, about its pose `ready`."""
    robot = load_robot(name)
    ready, limits = robot.poses["ready"][joint], robot.limits
    ends = {end: getattr(limits, end).copy() for end in ("q_min", "q_max")}
    for q in ends.values():
        q[joint] = ready + share * (q[joint] - ready)
    return robot.model_copy(update={"limits": limits.model_copy(update=ends)})


@pytest.fixture
def few_candidates(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tenth of the poses to choose from, where it is not the choice that is looked at: all are drawn alike."""
    monkeypatch.setattr("qrobot.ident.plan._CANDIDATES", 25)


@pytest.mark.sampled(6)
@pytest.mark.usefixtures("few_candidates")
@pytest.mark.parametrize("share", [0.01, 0.05, 0.3])
@pytest.mark.parametrize(("name", "joint"), [("puma560", 0), ("puma560", 2), ("puma560", 5), ("stanford", 2)])
def test_a_joint_that_is_fast_for_its_range_swings_within_it(name: str, joint: int, share: float) -> None:
    robot = with_range(name, joint, share)
    regressor = gravity_regressor(robot)
    swings = make_plan(robot, regressor, base_of_robot(robot, regressor), poses=12).swings
    assert len(swings) == 12 + 3 * robot.n
    for swing in swings:
        assert ((robot.limits.q_min < swing.low) & (swing.high < robot.limits.q_max)).all()


def test_an_arm_whose_pose_ready_is_not_clear_is_told_so(tmp_path: Path) -> None:
    text = robot_path("puma560").read_text().replace("base_height_m = 0.6604", "base_height_m = 0.0")
    path = tmp_path / "puma560.toml"
    path.write_text(text.replace("ready = [0, -90, 90, 0, 0, 0]", "ready = [0, 40, 90, 0, 0, 0]"))
    robot = load_robot(path)
    regressor = gravity_regressor(robot)
    with pytest.raises(IdentificationError, match=r"too near to the floor, .* robot file"):
        make_plan(robot, regressor, base_of_robot(robot, regressor), poses=12)


def lying(gravity: float) -> Robot:
    """A PUMA that hardly feels its weight."""
    geometry = PUMA.geometry.model_copy(update={"gravity_m_s2": np.array([gravity, 0.0, 0.0])})
    return PUMA.model_copy(update={"geometry": geometry})


@pytest.mark.usefixtures("few_candidates")
@pytest.mark.parametrize("gravity", [0.0, 1e-6])
def test_an_arm_no_joint_of_which_bears_weight_has_a_plan_for_its_friction(gravity: float) -> None:
    robot = lying(gravity)
    regressor = gravity_regressor(robot)
    base = base_of_robot(robot, regressor)
    assert base.leading == ()
    weightless = make_plan(robot, regressor, base, poses=12)
    assert len({tuple(swing.centre) for swing in weightless.swings if swing.name.startswith("pose")}) == 12
    assert (len(weightless.swings), weightless.condition) == (12 + 3 * PUMA.n, 1.0)


@ROBOTS
def test_every_swing_and_every_way_between_is_clear(name: str) -> None:
    robot = load_robot(name)
    clearance, at = Clearance(robot), robot.poses["ready"]
    for swing in plan(name).swings:
        stops = [at, robot.poses["ready"], swing.low] if swing.by_ready else [at, swing.low]
        assert all(clearance.of_way(begin, end) for begin, end in zip(stops, [*stops[1:], swing.high], strict=True))
        at = swing.low


@pytest.mark.thorough
@ROBOTS
def test_the_way_between_ready_and_every_swing_is_clear(name: str) -> None:
    """The first swing is gone to from there, any by --first N, and the arm goes back there after the last."""
    robot = load_robot(name)
    clearance = Clearance(robot)
    swings = [swing for seed in range(2) for swing in whole_plan(name, seed).swings]
    assert all(clearance.of_path(np.stack([robot.poses["ready"], swing.low, swing.high])) for swing in swings)


def test_a_joint_is_not_swept_where_no_clear_way_leads(tmp_path: Path) -> None:
    """An arm waits folded, its hand bent: half a turn of the wrist would lead the hand through the upper arm."""
    folded, beyond, above = [0, -90, 240, -90, 100, 0], [0, -90, 225, 90, 90, 0], [0, -90, 90, 0, 0, 0]
    path = tmp_path / "puma560.toml"
    path.write_text(robot_path("puma560").read_text().replace(f"ready = {above}", f"ready = {folded}"))
    robot = load_robot(path)
    clearance, centres = Clearance(robot), [np.radians(beyond), np.radians(above)]
    waist = next(_sweeps(robot, clearance, centres, (0.1,)))
    assert clearance.of_way(centres[0] - waist.half, centres[0] + waist.half)
    assert not clearance.of_way(robot.poses["ready"], centres[0] - waist.half)
    np.testing.assert_array_equal(waist.centre, centres[1])


@ROBOTS
def test_each_joint_is_swept_alone_at_three_speeds(name: str) -> None:
    sweeps = [swing.half for swing in plan(name).swings if not swing.name.startswith("pose")]
    moved = [np.flatnonzero(half).tolist() for half in sweeps]
    assert moved == [[joint] for joint in range(load_robot(name).n) for _ in range(3)]


def test_the_same_seed_gives_the_same_plan_and_another_seed_another() -> None:
    again = make_plan(*base("puma560"), poses=12)
    assert again.to_dict() == plan("puma560").to_dict()
    assert plan("puma560", seed=1).to_dict() != again.to_dict()


def test_chosen_poses_tell_more_than_random_ones() -> None:
    columns = np.random.default_rng(2).normal(size=(60, 3, 8)) * np.random.default_rng(3).uniform(0.1, 2.0, (60, 1, 1))

    def information(which: list[int]) -> float:
        stacked = columns[which].reshape(-1, 8)
        return float(np.linalg.slogdet(stacked.T @ stacked)[1])

    random = np.random.default_rng(4)
    others = [information(random.choice(60, 10, replace=False).tolist()) for _ in range(200)]
    assert information(choose_informative(columns, 10)) > max(others)


def test_what_alone_tells_a_parameter_is_chosen() -> None:
    columns = np.zeros((20, 1, 2))
    columns[:, 0, 0] = 1.0
    columns[13, 0] = [0.0, 0.1]
    assert 13 in choose_informative(columns, 3)


def test_the_plan_of_a_puma_is_well_conditioned_and_takes_minutes() -> None:
    assert plan("puma560").condition < 5.0
    assert 60.0 < plan("puma560").seconds < 240.0


def test_all_that_identification_records_takes_less_than_ten_minutes() -> None:
    """Swings and sweeps, slow ones among them, and the runs for inertia with ways between them as long as they are."""
    assert whole_plan("puma560").seconds + 2.0 * RUNS * RUN_S < 600.0


def test_too_few_poses_are_refused() -> None:
    with pytest.raises(IdentificationError, match="1 of 250 clear poses cannot tell 10 parameters"):
        make_plan(*base("puma560"), poses=1)
