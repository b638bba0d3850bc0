"""A tool that is led straight past singular poses by something that is held: slower, but straight, and out again."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.model.arm import Arm
from qrobot.model.transform import so3_log
from qrobot.motion.world.kinematics import NEAR_SINGULAR
from qrobot.rccl.connect import open_channel
from qrobot.rccl.held_motion import AXIS_DEG_S, AXIS_MM_S, JOINT_RAD_S, MOST_JOINT, WITHIN, HeldMotion
from qrobot.rccl.offline import OfflineLink
from qrobot.wire import Command, Hello, State
from tests.support.puma import ROBOT

PERIOD_S = 0.028
BEGINS_MS, BESIDE = 100.0, 12  # ms, poses
ARM = Arm(ROBOT)
AXES = ("dx", "dy", "dz", "rx", "ry", "rz")
OFF_LINE, OFF_AXIS = 1e-4, 1e-4  # m, rad
BESIDE_WRIST = (0.0, -1.0, 2.6, 0.4, 0.15, 0.0)


class Jogged(NamedTuple):
    """A press: setpoints (k, n), and why it ended before it was let go of."""

    q: Floats
    told: str

    @property
    def tool_speeds(self) -> Floats:
        """Of the last link, m/s. Shape (k - 1,)."""
        places = np.array([ARM.forward(q)[:3, 3] for q in self.q])
        return np.asarray(np.linalg.norm(np.diff(places, axis=0), axis=1) / PERIOD_S)


class KeptLink(OfflineLink):
    """An ideal arm whose samples are kept."""

    def __init__(self, hello: Hello, start: Floats, kept: list[Floats]) -> None:
        super().__init__(hello, ROBOT, start)
        self._kept = kept

    def exchange(self, command: Command | None) -> State:
        state = super().exchange(command)
        self._kept.append(np.array(state.robot.q))
        return state


def jog(start: Floats, axis: str, way: float, seconds: float, share: float = 1.0) -> Jogged:
    """Hold a key for a while."""
    kept: list[Floats] = []
    told = ""
    with open_channel(lambda hello: KeptLink(hello, start, kept), "puma560", PERIOD_S * 1e3) as arm:
        begins_ms = arm.time + BEGINS_MS
        held = lambda: axis if 0.0 <= arm.time - begins_ms < 1e3 * seconds else None  # noqa: E731
        motion = HeldMotion(arm, held)
        with motion.watched():
            arm.waitas(lambda: motion.held)
            try:
                motion.go_along(axis, way, share, in_base=True)
            except MotionError as error:
                told = str(error)
    return Jogged(np.array(kept), told)


def near_singular_pose(random: np.random.Generator) -> Floats:
    """Within the range of all joints, and some way from its ends."""
    low, high = ROBOT.limits.q_min + 0.3, ROBOT.limits.q_max - 0.3
    while True:
        q = random.uniform(low, high)
        least = np.linalg.svd(ARM.jacobian(q), compute_uv=False)[-1]
        if 0.1 * NEAR_SINGULAR < least < 0.7 * NEAR_SINGULAR:
            return np.asarray(q)


def assert_limits_are_kept(jogged: Jogged, share: float) -> None:
    most = np.minimum(MOST_JOINT * JOINT_RAD_S * share, WITHIN * ROBOT.limits.v_max)
    v = np.diff(jogged.q, axis=0) / PERIOD_S
    assert (np.abs(v).max(axis=0) <= 1.1 * most).all()  # within a piece a joint is not always as fast
    assert (np.abs(np.diff(v, axis=0) / PERIOD_S).max(axis=0) <= ROBOT.limits.a_max).all()


def assert_straight(jogged: Jogged, axis: str, way: float, share: float) -> None:
    """All along one axis of the base: what is not along it does not change; never faster than was asked for.

    What comes after the key was let go of is a stop of the joints, which is no straight line, and is left out.
    """
    first = ARM.forward(jogged.q[0])
    along = np.eye(3)["xyz".index(axis[1])] * way
    for q, after in zip(jogged.q[:-1], jogged.q[1:], strict=True):
        T, T_after = ARM.forward(q), ARM.forward(after)
        turned, gone = so3_log(T[:3, :3] @ first[:3, :3].T), T[:3, 3] - first[:3, 3]
        step = so3_log(T_after[:3, :3] @ T[:3, :3].T) if axis[0] == "r" else T_after[:3, 3] - T[:3, 3]
        moved, still = (turned, gone) if axis[0] == "r" else (gone, turned)
        assert np.linalg.norm(still) < OFF_AXIS
        assert np.linalg.norm(moved - (moved @ along) * along) < OFF_LINE
        full = AXIS_DEG_S * np.pi / 180.0 if axis[0] == "r" else AXIS_MM_S * 1e-3
        assert -1e-6 <= step @ along <= 1.02 * full * share * PERIOD_S


@pytest.mark.parametrize("number", range(BESIDE))
def test_beside_any_singular_pose_the_tool_goes_straight_and_joints_keep_their_limits(number: int) -> None:
    random = np.random.default_rng(number)
    start, axis, way = near_singular_pose(random), random.choice(AXES), random.choice([-1.0, 1.0])
    share = random.choice([0.5, 1.0, 4.0])
    jogged = jog(start, axis, way, 2.0, share)
    assert_limits_are_kept(jogged, share)
    until = round((BEGINS_MS * 1e-3 + 2.0) / PERIOD_S)
    assert_straight(Jogged(jogged.q[:until], ""), axis, way, share)
    assert np.ptp(jogged.q, axis=0).max() > 1e-3 or jogged.told


def test_past_a_singular_wrist_the_tool_slows_down_and_gets_its_speed_back() -> None:
    """The wrist turns by more than two right angles on the way; it used to end with a joint that would be too fast."""
    jogged = jog(np.array(BESIDE_WRIST), "dz", -1.0, 7.0)
    assert jogged.told == ""
    assert_limits_are_kept(jogged, 1.0)
    speeds = jogged.tool_speeds
    middle = int(np.abs(jogged.q[:, 4]).argmin())
    assert speeds[middle] < 0.4 * AXIS_MM_S * 1e-3
    for half in (speeds[:middle], speeds[middle:]):
        assert half.max() > 0.9 * AXIS_MM_S * 1e-3
    assert abs(jogged.q[-1, 3] - jogged.q[0, 3]) > 2.0


@pytest.mark.parametrize(
    ("start", "axis"),
    [((0.0, -1.0, 2.6, 0.4, 0.15, 0.0), "dx"), ((0.0, -1.2, 2.8, np.pi / 2, 0.25, 0.0), "ry")],
    ids=["a stretched arm", "through the wrist"],
)
def test_where_no_way_leads_on_the_tool_comes_to_rest_slowly_and_goes_back(start: tuple[float, ...], axis: str) -> None:
    jogged = jog(np.array(start), axis, 1.0, 12.0)
    assert "can go no further this way" in jogged.told
    assert_limits_are_kept(jogged, 1.0)
    back = jog(jogged.q[-1], axis, -1.0, 3.0)
    assert back.told == ""
    assert_limits_are_kept(back, 1.0)
    assert np.abs(ARM.forward(back.q[-1]) - ARM.forward(jogged.q[-1])).max() > 0.02
