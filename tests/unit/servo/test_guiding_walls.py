"""The walls before the ends of a led joint's range: they push nothing that no hand pushes, whatever the range."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from qrobot.arrays import Floats
from qrobot.config import Robot, load_robot
from qrobot.modecodes import Mode
from qrobot.rccl_bridge.request_port import tell_key
from qrobot.servo.memory.setpoint_queue import TORQUE_SETPOINT
from qrobot.servo.memory.telemetry import Rows
from tests.support.servo_bench import ServoBench, play

STREAM, JOINT = 1, 2
SLIDE_M, NARROW_RAD = 0.06, 0.08
SETTLED = -100  # the last tenth of a second


def with_range(name: str, joint: int, span: float) -> Robot:
    """A robot, one of whose joints has a short range around its pose `park`."""
    robot = load_robot(name)
    q_min, q_max = robot.limits.q_min.copy(), robot.limits.q_max.copy()
    q_min[joint], q_max[joint] = robot.poses["park"][joint] + np.array([-0.5, 0.5]) * span
    return robot.model_copy(update={"limits": robot.limits.model_copy(update={"q_min": q_min, "q_max": q_max})})


ROBOTS = [
    load_robot("puma560"),
    load_robot("stanford"),
    with_range("stanford", JOINT, SLIDE_M),
    with_range("puma560", JOINT, NARROW_RAD),
]
IDS = ["puma", "stanford", "a slide of 60 mm", "a joint of 4.6 degrees"]


def led_from(robot: Robot, q: Floats, hand: Callable[[float], Floats] | None = None) -> ServoBench:
    """An arm whose key is pressed where it stands; the hand takes it along a path, or there is none."""
    bench = ServoBench(robot)
    bench.q = q.copy()
    bench.hold().follows = False
    start_ns = bench.now_ns

    def lead(now_ns: int) -> None:
        tell_key(bench.mailbox, STREAM, now_ns)
        if hand is not None:
            bench.q = hand((now_ns - start_ns) * 1e-9)

    def give_way(_seq: int, modes: list[int], values: Floats) -> None:
        modes[:] = [TORQUE_SETPOINT] * len(modes)
        values[:] = 0.0

    bench.before.append(lead)
    play(bench, lambda _t: q.copy(), edit=give_way)
    return bench


def led_rows(bench: ServoBench, seconds: float) -> Rows:
    """Telemetry from the instant on at which the hand had the arm."""
    first = len(bench.rows())
    bench.until(lambda: bool(bench.state.guided))
    bench.run(seconds)
    assert bench.mode is Mode.TRACKING
    return bench.rows()[first:]


@pytest.mark.parametrize("robot", ROBOTS, ids=IDS)
def test_wherever_the_joints_stand_when_the_key_is_pressed_no_wall_pushes_them(robot: Robot) -> None:
    low, high = robot.limits.q_min, robot.limits.q_max
    for share in np.linspace(0.0, 1.0, 20):
        rows = led_rows(led_from(robot, low + share * (high - low)), 0.2)[SETTLED:]
        np.testing.assert_array_equal(rows["q_ref"], rows["q"])
        assert not rows["v_ref"].any()


@pytest.mark.parametrize("robot", ROBOTS[2:], ids=IDS[2:])
@pytest.mark.parametrize("way", [1.0, -1.0], ids=["upwards", "downwards"])
def test_a_hand_that_leads_a_joint_from_end_to_end_meets_one_wall_and_no_leap(robot: Robot, way: float) -> None:
    park, seconds = np.array(robot.poses["park"]), 6.0
    ends = robot.limits.q_min[JOINT], robot.limits.q_max[JOINT]
    first, last = ends if way > 0.0 else ends[::-1]

    def hand(t: float) -> Floats:
        share = min(max((t - 0.5) / seconds, 0.0), 1.0)
        q = park.copy()
        q[JOINT] = first + (last - first) * 0.5 * (1.0 - np.cos(np.pi * share))
        return q

    rows = led_rows(led_from(robot, hand(0.0), hand), seconds + 1.0)
    fastest = 0.5 * np.pi * (ends[1] - ends[0]) / seconds
    friction = robot.friction[robot.control.friction_preset]
    of_the_speed = robot.control.kv[JOINT] * fastest + friction.coulomb_pos[JOINT]  # both end at a wall
    assert np.abs(np.diff(rows["tau"][:, JOINT])).max() < 1.2 * of_the_speed < 0.2 * robot.guard.tau_max[JOINT]
    behind = way * (rows["q"] - rows["q_ref"])[:, JOINT]  # how deep in the wall
    assert (behind >= 0.0).all()
    assert not behind[: len(rows) // 2].any()
    assert 0.2 * (ends[1] - ends[0]) < behind[-1] < 0.3 * (ends[1] - ends[0])
