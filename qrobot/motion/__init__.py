"""The engine under every programming library: requests in, one joint setpoint per sample out.

Pure: time is an argument. The world model is `trsf` (transforms of four kinds), `product` and `equation`. `request`
says what to do, `geometric_path` which way leads there in some `coordinates`, `timing` how long it takes. `path`
joins pieces (`path_piece`) by transitions (`blend`), `via_point` leads from one segment into the next, `path_stop`
and `replan` leave it early, `joint_stop` leaves it altogether, `trajectory_state` is how far the arm is on it,
`setpoint_check` judges each setpoint, and `generator` decides which of them comes when. `force` lets joints give way
(`joint_matching`, `compliance`) and feels (`external_torque`) what the arm exerts.
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
