"""Compile, or load from the cache, what a generator calls, before a robot waits for its setpoints."""

from __future__ import annotations

import contextlib
from functools import cache

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import MotionError
from qrobot.model.arm import Arm
from qrobot.model.transform import rot_z, transform
from qrobot.motion.force.controlled_frame import controlled_frame
from qrobot.motion.force.external_torque import ArmSample, ExternalTorque
from qrobot.motion.generator import Generator
from qrobot.motion.path.blend import Blend
from qrobot.motion.planning.setpoint_check import judge_row
from qrobot.motion.request import Duration, MotionMode, MotionSpeed, MoveRequest, SpeedShare, ToolSpeed
from qrobot.motion.world.drive_transform import OrientationInterpolation
from qrobot.motion.world.equation import Equation
from qrobot.motion.world.kinematics import ArmKinematics
from qrobot.motion.world.limits import MotionLimits
from qrobot.motion.world.trsf import T6, TransformKind, Trsf

_PERIOD_S = 0.05
_TICKS = 40
_MODES = MotionMode.CARTESIAN, MotionMode.JOINT, MotionMode.CARTESIAN


@cache
def warm_up(n: int, blend: Blend) -> None:
    """Make a generator for `n` joints do everything once in joint space: move, turn, be interrupted and stop."""
    one = np.ones(n)
    limits = MotionLimits(-one, one, one, 10.0 * one, 10.0 * one, np.zeros(n, dtype=np.bool_), ("joint",) * n)
    generator = Generator(limits, _PERIOD_S, 0.0 * one, blend=blend)
    for target in (0.1, 0.0, 0.1, 0.0):
        generator.push(MoveRequest("warm-up", target * one, Duration(0.6)))
    for tick in range(1, _TICKS):
        if tick == _TICKS // 4:
            generator.skip(1)
        if tick == _TICKS // 2:
            generator.stop(0.1)
        generator.update(tick)
    judge_row(np.zeros((3, n)), _PERIOD_S, limits, blend)  # of lines that begin at a corner


def warm_up_force(robot: Robot) -> None:
    """Make what feels and exerts forces look at a robot once."""
    q, still = np.array(robot.poses["park"] if "park" in robot.poses else np.zeros(robot.n)), np.zeros(robot.n)
    external = ExternalTorque(robot, _PERIOD_S)
    external.observe(ArmSample(q, still, still, q), 1)
    external.estimate()
    external.gravity(q)
    external.friction.hint(still, external.friction.added(external.friction.setpoint(still, still)))
    controlled_frame(Arm(robot), q, np.eye(4))


def warm_up_cartesian(limits: MotionLimits, kinematics: ArmKinematics, q: Floats, blend: Blend) -> None:
    """Make a generator do everything once in Cartesian space around joint positions `q` (n,), which the arm can have.

    To a goal that drifts, back in joint mode, in two angles, with an offset, interrupted and stopped.
    """
    pose = kinematics.forward(q)
    with contextlib.suppress(MotionError):  # at the very end of a range it may be outside, by a rounding
        kinematics.inverse(pose, kinematics.branch(q), q, singular=True)

    def drift(belt: Trsf) -> None:
        belt.value[0, 3] += 1e-5

    belt, place, tool = (
        Trsf("belt", TransformKind.FUNCTION, function=drift),
        Trsf("place", TransformKind.HOLD, pose),
        Trsf("tool"),
    )
    goal = Equation("warm-up", [T6, tool], [belt, place], tool)
    generator = Generator(limits, _PERIOD_S, q, blend=blend, kinematics=kinematics)
    paces: tuple[MotionSpeed, ...] = (ToolSpeed(0.2, 1.0), Duration(1.0), SpeedShare(0.3))
    for mode, speed, turn in zip(
        _MODES,
        paces,
        (OrientationInterpolation.ONE_AXIS, OrientationInterpolation.ONE_AXIS, OrientationInterpolation.TWO_ANGLES),
        strict=True,
    ):
        target = goal.goal(offset=transform(rot_z(0.1), [0.0, 0.0, -0.01]))
        with contextlib.suppress(MotionError):  # an arm that cannot do it there has been asked at least
            generator.push(MoveRequest("warm-up", target, speed, mode=mode, turn=turn))
    for tick in range(1, 2 * _TICKS):
        if tick == _TICKS:
            generator.skip(1)
        if tick == _TICKS + _TICKS // 2:
            generator.stop(0.1)
        generator.update(tick)
    kinematics.near_singular(q)
