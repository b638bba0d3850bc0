"""Multi-RCCL: several arms and object frames in one program (Lloyd, Parker and McClain 1987, section 3).

    from qrobot.multi_rccl import EQ, TL, TRANS, make_position, move, rccl_control, rccl_open, wait_for

    left, right = rccl_open("left", bridge=":5600"), rccl_open("right", bridge=":5601")
    for arm in (left, right):
        rccl_control(arm)
    move(left, make_position(TRANS, tool, EQ, coord, p, TL, tool))
    wait_for(left.completed)

Transforms and the calls that set motion parameters are RCCL's, the latter with the manipulator as first argument.
Degrees, millimetres and milliseconds. Where the arms are: `rccl_open`, or whoever starts the program.
"""

from __future__ import annotations

from qrobot.multi_rccl.manip import Manip
from qrobot.multi_rccl.object_frame import ObjectFrame
from qrobot.multi_rccl.positions import TRANS, make_position
from qrobot.multi_rccl.program import (
    OBJECT_FRAME,
    cancel,
    collision,
    comply,
    distance,
    evalfn,
    grasp,
    jposition,
    keep_path,
    kept,
    limit,
    lock,
    maintain,
    move,
    open_hand,
    override,
    pause,
    pose,
    rccl_control,
    rccl_open,
    rccl_release,
    resume,
    retract,
    setconf,
    setime,
    setjvel,
    setload,
    setmode,
    setvel,
    stop,
    teach,
    tracking_mode,
    update,
    wait_as,
    wait_for,
)
from qrobot.multi_rccl.robot_manip import RobotManip
from qrobot.rccl import EQ, TL

__all__ = [
    "EQ",
    "OBJECT_FRAME",
    "TL",
    "TRANS",
    "Manip",
    "ObjectFrame",
    "RobotManip",
    "cancel",
    "collision",
    "comply",
    "distance",
    "evalfn",
    "grasp",
    "jposition",
    "keep_path",
    "kept",
    "limit",
    "lock",
    "maintain",
    "make_position",
    "move",
    "open_hand",
    "override",
    "pause",
    "pose",
    "rccl_control",
    "rccl_open",
    "rccl_release",
    "resume",
    "retract",
    "setconf",
    "setime",
    "setjvel",
    "setload",
    "setmode",
    "setvel",
    "stop",
    "teach",
    "tracking_mode",
    "update",
    "wait_as",
    "wait_for",
]
