"""Plans keep off the fences of the deployment: every way, every run, and the places where the servo would stop it."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.config.fences import Fence
from qrobot.errors import FenceCrossed, IdentificationError
from qrobot.fences.fence_set import FenceSet
from qrobot.ident.base import base_of_robot
from qrobot.ident.excitation import RUN_S, RUNS, Excitation, make_excitation
from qrobot.ident.perform import setpoints_of
from qrobot.ident.plan import ExcitationPlan, make_plan
from qrobot.ident.regressor import gravity_regressor, inertial_regressor
from qrobot.rccl.setpoints import check_fences

PUMA = load_robot("puma560")
READY = PUMA.poses["ready"]
# those of docs/how-to/keep-inside-fences.md
BENCH = Fence(name="bench", shape="box", size_m=(0.6, 1.2, 0.1), position_m=(0.6, 0.0, -0.35))
CELL = Fence(
    name="cell",
    shape="cylinder",
    keep="in",
    bodies="tool",
    radius_m=0.9,
    length_m=2.4,
    position_m=(0.0, 0.0, 0.5),
    margin_m=0.05,
)
FENCES = FenceSet(PUMA, [BENCH, CELL], self_collision=True, self_margin=0.01)


@cache
def planned(fences: FenceSet | None) -> ExcitationPlan:
    regressor = gravity_regressor(PUMA)
    return make_plan(PUMA, regressor, base_of_robot(PUMA, regressor), fences=fences)


@cache
def excited(fences: FenceSet | None) -> Excitation:
    regressor = inertial_regressor(PUMA)
    return make_excitation(PUMA, regressor, base_of_robot(PUMA, regressor), RUNS, fences=fences)


def check_swings(plan: ExcitationPlan) -> None:
    at = READY
    for swing in plan.swings:
        ways = [at, *([READY] if swing.by_ready else []), swing.low, swing.high, swing.low, READY]
        for begin, end in pairwise(ways):
            FENCES.check_path(lambda share, _, a=begin, b=end: a + share * (b - a), begin, swing.name)
            assert (FENCES.slack(end) >= 0.0).all()
        at = swing.low


def check_runs(made: Excitation) -> None:
    at = READY
    for run in made.runs:
        ways = [at, *([READY] if run.by_ready else []), run.motion.start, READY]
        for begin, end in pairwise(ways):
            FENCES.check_path(lambda share, _, a=begin, b=end: a + share * (b - a), begin, run.name)
        check_fences(setpoints_of(PUMA, run).q, FENCES, run.name)
        at = run.motion.start


@pytest.mark.thorough
def test_every_swing_and_every_way_keeps_inside_the_fences() -> None:
    check_swings(planned(FENCES))
    with pytest.raises(FenceCrossed):
        check_swings(planned(None))


def test_every_fast_run_and_every_way_keeps_inside_the_fences() -> None:
    check_runs(excited(FENCES))


@pytest.mark.thorough
def test_without_fences_a_fast_run_or_a_way_would_cross_one() -> None:
    with pytest.raises(FenceCrossed):
        check_runs(excited(None))


def test_a_fast_run_that_is_stopped_anywhere_rests_before_the_fences() -> None:
    """A stop of T seconds at no more than a_stop, whose greatest slope is 1.875 of the mean, covers v T/2."""
    for run in excited(FENCES).runs:
        states = run.motion.at(np.linspace(0.0, RUN_S, 401))
        for q, v in zip(states.q, states.v, strict=True):
            stopped = q + 0.5 * v * 1.875 * float((np.abs(v) / PUMA.guard.a_stop).max())
            assert (FENCES.distances(stopped) > 0.0).all()


def test_an_arm_whose_pose_ready_is_beyond_a_fence_is_told_so_before_a_plan_is_sought() -> None:
    ceiling = Fence(name="ceiling", shape="plane", keep="in", position_m=(0.0, 0.0, 0.5))
    for plan in (planned, excited):
        with pytest.raises(IdentificationError, match=r"mm inside fence 'ceiling', .* move it in the robot file"):
            plan(FenceSet(PUMA, [ceiling]))


def test_an_arm_whose_pose_ready_is_too_near_to_a_fence_is_told_how_near() -> None:
    top = 0.02 + max(max(a[2], b[2]) + radius for _, a, b, radius in FENCES.capsules_at(READY))
    ceiling = Fence(name="ceiling", shape="plane", keep="in", position_m=(0.0, 0.0, top), margin_m=0.05)
    with pytest.raises(IdentificationError, match=r"is 20\.0 mm off fence 'ceiling', and plans keep 55 mm away"):
        planned(FenceSet(PUMA, [ceiling]))
