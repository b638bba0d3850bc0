"""The engine under every programming library: requests in, one joint setpoint per sample out.

Pure: time is an argument. The world model is `trsf` (transforms of four kinds), `product` and `equation`. `request`
says what to do, `course` which way leads there in the coordinates of a `chart`, `schedule` how long it takes. `path`
joins legs (`leg`) by transitions (`blend`), `corner` turns from one into the next, `brake` and `diversion` leave it
early, `halt` leaves it altogether, `progress` is how far the arm is on it, `watch` judges each setpoint, and
`generator` decides which of them comes when. `force` lets joints give way (`matching`, `compliance`) and feels
(`external`) what the arm exerts.
"""

from qrobot.motion.blend import Blend, Correction
from qrobot.motion.compliance import Compliance, Drift, ForceLimits
from qrobot.motion.drive_transform import OrientationInterpolation
from qrobot.motion.equation import Equation, Goal
from qrobot.motion.event import EventKind, MotionEvent, Termination
from qrobot.motion.external_torque import ArmSample, Exerted
from qrobot.motion.force import ForceControl
from qrobot.motion.generator import Generator
from qrobot.motion.kinematics import Reach, reach_of
from qrobot.motion.limits import MotionLimits, motion_limits
from qrobot.motion.output import Output
from qrobot.motion.request import (
    HERE,
    Duration,
    JointSpeed,
    MotionMode,
    MotionSpeed,
    MoveRequest,
    SpeedShare,
    ToolSpeed,
)
from qrobot.motion.trsf import T6, TransformKind, Trsf
from qrobot.motion.warm_up import warm_up, warm_up_cartesian, warm_up_force

__all__ = [
    "HERE",
    "T6",
    "ArmSample",
    "Blend",
    "Compliance",
    "Correction",
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
    "OrientationInterpolation",
    "Output",
    "Reach",
    "SpeedShare",
    "Termination",
    "ToolSpeed",
    "TransformKind",
    "Trsf",
    "motion_limits",
    "reach_of",
    "warm_up",
    "warm_up_cartesian",
    "warm_up_force",
]
