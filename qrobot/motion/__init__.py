"""The engine under every programming library: requests in, one joint setpoint per sample out.

Pure: time is an argument. The world model is `trsf` (transforms of four kinds), `product` and `equation`. `request`
says what to do, `geometric_path` which way leads there in some `coordinates`, `timing` how long it takes. `path`
joins pieces (`path_piece`) by transitions (`blend`), `via_point` leads from one segment into the next, `path_stop`
and `replan` leave it early, `joint_stop` leaves it altogether, `trajectory_state` is how far the arm is on it,
`setpoint_check` judges each setpoint, and `generator` decides which of them comes when. `force` lets joints give way
(`joint_matching`, `compliance`) and feels (`external_torque`) what the arm exerts. `kept` leads an arm back that the
servo has stopped: to its path (`kept_path`), or from what it met (`retreat`).
"""

from qrobot.motion.event import EventKind, MotionEvent, Termination
from qrobot.motion.force.external_torque import ArmSample, Exerted
from qrobot.motion.force.force_control import ForceControl
from qrobot.motion.generator import Generator
from qrobot.motion.path.blend import Blend, Correction
from qrobot.motion.request import (
    HERE,
    TURN_PER_MM,
    Displacement,
    Duration,
    JointSpeed,
    MotionMode,
    MotionSpeed,
    MoveRequest,
    SpeedShare,
    ToolSpeed,
    enough_samples,
    whole_samples,
)
from qrobot.motion.trajectory.output import Output
from qrobot.motion.trajectory.planned_path import PlannedPath
from qrobot.motion.trajectory.speed_override import FULL_SPEED
from qrobot.motion.warm_up import warm_up, warm_up_cartesian, warm_up_force
from qrobot.motion.world.compliance import Compliance, Drift, ForceLimits
from qrobot.motion.world.drive_transform import OrientationInterpolation
from qrobot.motion.world.equation import Equation, Goal
from qrobot.motion.world.kinematics import ArmKinematics, kinematics_of
from qrobot.motion.world.limits import MotionLimits, motion_limits
from qrobot.motion.world.numerical_kinematics import NumericalKinematics
from qrobot.motion.world.trsf import T6, TransformKind, Trsf

__all__ = [
    "FULL_SPEED",
    "HERE",
    "T6",
    "TURN_PER_MM",
    "ArmKinematics",
    "ArmSample",
    "Blend",
    "Compliance",
    "Correction",
    "Displacement",
    "Drift",
    "Duration",
    "Equation",
    "EventKind",
    "Exerted",
    "ForceControl",
    "ForceLimits",
    "Generator",
    "Goal",
    "JointSpeed",
    "MotionEvent",
    "MotionLimits",
    "MotionMode",
    "MotionSpeed",
    "MoveRequest",
    "NumericalKinematics",
    "OrientationInterpolation",
    "Output",
    "PlannedPath",
    "SpeedShare",
    "Termination",
    "ToolSpeed",
    "TransformKind",
    "Trsf",
    "enough_samples",
    "kinematics_of",
    "motion_limits",
    "warm_up",
    "warm_up_cartesian",
    "warm_up_force",
    "whole_samples",
]
