"""The PUMA's generator, and frames to move it with."""

from __future__ import annotations

from functools import cache

import numpy as np

from qrobot.config import load_robot
from qrobot.model.arm import Arm
from qrobot.model.transform import rot_z, transform
from qrobot.motion import (
    T6,
    ArmKinematics,
    Blend,
    Equation,
    Generator,
    MotionLimits,
    TransformKind,
    Trsf,
    kinematics_of,
    motion_limits,
)
from qrobot.motion.path.blend import Correction

PERIOD_S = 0.028
ROBOT = load_robot("puma560")
PARK = ROBOT.poses["park"]
LIMITS: MotionLimits = motion_limits(ROBOT)


@cache
def arm() -> Arm:
    return Arm(ROBOT)


def kinematics() -> ArmKinematics:
    found = kinematics_of(arm())
    assert found is not None
    return found


def puma_generator(
    q=PARK, period_s: float = PERIOD_S, blend: Blend = Blend.QUARTIC, correction: Correction = Correction.SMOOTH
) -> Generator:
    return Generator(LIMITS, period_s, np.array(q), blend=blend, kinematics=kinematics(), correction=correction)


def const(name: str, x: float = 0.0, y: float = 0.0, z: float = 0.0, rotation=None) -> Trsf:
    return Trsf(name, TransformKind.CONST, transform(rotation, [x, y, z]))


TOOL = const("TOOL", z=0.1)


def at_park(*terms: Trsf, name: str = "P", tool: Trsf = TOOL) -> Equation:
    """T6 TOOL = PARK terms: from where the tool is at park, by `terms`."""
    return Equation(
        name, (T6, tool), (Trsf("PARK", TransformKind.CONST, arm().forward(PARK) @ tool.value), *terms), tool
    )


def shift(x: float = 0.0, y: float = 0.0, z: float = 0.0, turn: float = 0.0) -> Trsf:
    return const("SHIFT", x, y, z, rot_z(turn))


class Conveyor:
    """A functional transform whose frame moves along its axes as `way`, a function of seconds, says."""

    def __init__(self, way, period_s: float = PERIOD_S) -> None:
        self.tick = 0
        self.calls = 0
        self._way, self._period_s = way, period_s
        self.trsf = Trsf("CONV", TransformKind.FUNCTION, function=self._move)

    def _move(self, trsf: Trsf) -> None:
        self.calls += 1
        trsf.value = self.pose(self.tick)

    def pose(self, tick: int) -> np.ndarray:
        x, y, z, turn = self._way(tick * self._period_s)
        return transform(rot_z(turn), [x, y, z])
