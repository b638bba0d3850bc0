"""The engine under every programming library: requests in, one joint setpoint per sample out.

Pure: time is an argument. `request` says what to do, `schedule` how long it takes, `path` joins legs (`leg`) by
transitions (`blend`), `brake` and `diversion` leave it early, and `generator` decides which of them comes when.
"""

from qrobot.motion.blend import Blend
from qrobot.motion.events import EventKind, MotionEvent, Termination
from qrobot.motion.generator import Generator, Output
from qrobot.motion.limits import MotionLimits, motion_limits
from qrobot.motion.request import Duration, JointSpeed, MoveRequest, Pace, SpeedShare
from qrobot.motion.warm import warm_up

__all__ = [
    "Blend",
    "Duration",
    "EventKind",
    "Generator",
    "JointSpeed",
    "MotionEvent",
    "MotionLimits",
    "MoveRequest",
    "Output",
    "Pace",
    "SpeedShare",
    "Termination",
    "motion_limits",
    "warm_up",
]
