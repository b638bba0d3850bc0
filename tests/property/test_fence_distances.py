"""The distance kernels against many points of each capsule, and against another library."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot.config import load_robot
from qrobot.config.fences import Fence
from qrobot.fences.distance import axes_apart
from qrobot.fences.fence_set import FenceSet
from qrobot.model.transform import rpy
from tests.support import fences as slowly
from tests.support.thorough import examples

ROBOT = load_robot("puma560")
SHAPE = ROBOT.shape
assert SHAPE is not None
PAIRS = [(a, b) for a in SHAPE.capsules for b in SHAPE.capsules if [a.name, b.name] in map(list, SHAPE.apart)]

Point = tuple[float, float, float]
coordinate = st.floats(-1.2, 1.2)
place = st.tuples(coordinate, coordinate, coordinate)
angle = st.floats(-180.0, 180.0)
size = st.floats(0.02, 1.5)
share = st.tuples(*[st.floats(0.0, 1.0)] * 6)


@st.composite
def some_fence(draw: st.DrawFn) -> Fence:
    """A fence of any shape, size and pose."""
    shape = draw(st.sampled_from(["box", "cylinder", "plane"]))
    sizes = {"box": {"size_m": (draw(size), draw(size), draw(size))},
             "cylinder": {"radius_m": draw(size), "length_m": draw(size)}, "plane": {}}[shape]  # fmt: skip
    return Fence(
        name="some", shape=shape, position_m=draw(place), rpy_deg=(draw(angle), draw(angle), draw(angle)),
        keep=draw(st.sampled_from(["in", "out"])), bodies=draw(st.sampled_from(["all", "links", "tool"])), **sizes,
    )  # fmt: skip


def joints(shares: tuple[float, ...]) -> np.ndarray:
    """A pose in the range of the arm."""
    low, high = ROBOT.limits.q_min, ROBOT.limits.q_max
    return np.asarray(low + np.array(shares) * (high - low))


@settings(max_examples=examples(60))
@given(some_fence(), share)
def test_the_distance_is_that_of_the_nearest_of_many_points(fence: Fence, shares: tuple[float, ...]) -> None:
    q = joints(shares)
    wanted = {"all": (True, False), "tool": (True,), "links": (False,)}[fence.bodies]
    capsules = [each for each in SHAPE.capsules if each.link > 0 and (each.link == ROBOT.n) in wanted]
    by_hand = {each.name: slowly.distance(ROBOT, each, fence, q) for each in capsules}
    found = FenceSet(ROBOT, [fence]).nearness(q)[0]
    assert found.distance == pytest.approx(min(by_hand.values()), abs=2e-4)
    assert by_hand[found.body] == pytest.approx(min(by_hand.values()), abs=3e-4)


@settings(max_examples=examples(25))
@given(share)
def test_the_arm_is_as_far_from_itself_as_the_nearest_of_its_pairs(shares: tuple[float, ...]) -> None:
    q = joints(shares)
    (found,) = FenceSet(ROBOT, [], self_collision=True).nearness(q)
    nearest = min(slowly.apart(ROBOT, one, other, q) for one, other in PAIRS)
    assert found.fence == "itself"
    assert found.distance == pytest.approx(nearest, abs=3e-3)


@given(place, place, place, place)
def test_two_axes_are_as_far_apart_in_either_order_and_never_further_than_their_ends(
    a: Point, b: Point, c: Point, d: Point
) -> None:
    found = axes_apart(a, b, c, d)
    assert found == pytest.approx(axes_apart(c, d, a, b), abs=1e-9)
    assert found == pytest.approx(axes_apart(b, a, c, d), abs=1e-7)
    between = np.linalg.norm(
        np.linspace(a, b, 41)[:, None, :] - np.linspace(c, d, 41)[None, :, :], axis=2
    ).min()  # at most half a step of each axis further than the truth
    step = (np.linalg.norm(np.subtract(a, b)) + np.linalg.norm(np.subtract(c, d))) / 80
    assert between - step - 1e-9 <= found <= between + 1e-9


def test_mujoco_finds_the_same_distance_from_boxes() -> None:
    mujoco = pytest.importorskip("mujoco")
    random = np.random.default_rng(18)
    apart = 0
    for _ in range(12):
        position, rpy_deg = random.uniform(-1.0, 1.0, 3), random.uniform(-180.0, 180.0, 3)
        edges, q = random.uniform(0.02, 1.0, 3), joints(tuple(random.uniform(0.0, 1.0, 6)))
        fences = FenceSet(ROBOT, [Fence(name="box", shape="box", size_m=edges, position_m=position, rpy_deg=rpy_deg)])
        spec, quat = mujoco.MjSpec(), np.zeros(4)
        mujoco.mju_mat2Quat(quat, rpy(*np.radians(rpy_deg)).ravel())
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=edges / 2, pos=position, quat=quat)
        for _name, start, end, radius in fences.capsules_at(q)[1:]:  # the base is no part of it
            rod = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[radius, 0.0, 0.0])
            rod.fromto = [*start, *end]
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        theirs = min(mujoco.mj_geomDistance(model, data, 0, k, 10.0, None) for k in range(1, model.ngeom))
        ours = fences.nearness(q)[0].distance
        assert (ours > 0.0) == (theirs > 0.0)
        if ours > 0.0:  # where bodies overlap, depth has another definition there
            apart += 1
            assert theirs == pytest.approx(ours, abs=1e-4)
    assert apart > 3
