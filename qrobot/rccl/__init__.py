"""RCCL in Python: an arm programmed with the calls of the papers (Hayward & Paul 1986).

    from qrobot import rccl

    with rccl.control("puma560") as arm:
        arm.move(arm.pose("park"))
        arm.waitfor(arm.completed)

`control` returns a `Channel`; its calls are also functions of this module, for the arm taken last, as in C, and so are
RCCL's global variables `completed`, `nbrequest`, `how`, `chg`, `park` and `there`, and `kept`, `joints`, `time`,
`exerted` and `overruns`. Transforms and position equations belong to no arm: `newtrans`, the `gentr_` family,
`makeposition`, `DataBase`. Degrees, millimetres and milliseconds at this boundary. Where the robot is, is chosen
outside the program: `use` for whoever starts it, else the variable QROBOT_BRIDGE ("host:port"), else the default port
of this machine.
"""

from __future__ import annotations

from typing import Any

from qrobot.motion import Blend, Termination
from qrobot.rccl import program
from qrobot.rccl.channel import NO, YES, Channel
from qrobot.rccl.database import DataBase
from qrobot.rccl.event import Event
from qrobot.rccl.position import EQ, TL, Position, makeposition
from qrobot.rccl.program import (
    CLOSE,
    OPEN,
    analog,
    collision,
    comply,
    control,
    distance,
    each_sample,
    evalfn,
    finish,
    jposition,
    keep_path,
    limit,
    lock,
    log_signal,
    move,
    nextmove,
    override,
    pause,
    pose,
    release,
    resume,
    retract,
    sample,
    setconf,
    setime,
    setjvel,
    setload,
    setmode,
    setvel,
    signal,
    stop,
    teach,
    update,
    use,
    waitas,
    waitfor,
)
from qrobot.rccl.transforms import (
    Transform,
    assigntr,
    const,
    gentr_eul,
    gentr_pao,
    gentr_rot,
    gentr_rpy,
    gentr_trsl,
    hold,
    invert,
    newtrans,
    rot,
    t6,
    trmult,
    trsl,
    varb,
    xunit,
    yunit,
    zunit,
)

__all__ = [
    "CLOSE",
    "EQ",
    "NO",
    "OPEN",
    "TL",
    "YES",
    "Blend",
    "Channel",
    "DataBase",
    "Event",
    "Position",
    "Termination",
    "Transform",
    "analog",
    "assigntr",
    "collision",
    "comply",
    "const",
    "control",
    "distance",
    "each_sample",
    "evalfn",
    "finish",
    "gentr_eul",
    "gentr_pao",
    "gentr_rot",
    "gentr_rpy",
    "gentr_trsl",
    "hold",
    "invert",
    "jposition",
    "keep_path",
    "limit",
    "lock",
    "log_signal",
    "makeposition",
    "move",
    "newtrans",
    "nextmove",
    "override",
    "pause",
    "pose",
    "release",
    "resume",
    "retract",
    "rot",
    "sample",
    "setconf",
    "setime",
    "setjvel",
    "setload",
    "setmode",
    "setvel",
    "signal",
    "stop",
    "t6",
    "teach",
    "trmult",
    "trsl",
    "update",
    "use",
    "varb",
    "waitas",
    "waitfor",
    "xunit",
    "yunit",
    "zunit",
]


def __getattr__(name: str) -> Any:
    """RCCL's global variables: those of the arm in use at this moment, so they are no names one could import."""
    if name in program.VARIABLES:
        return program.VARIABLES[name](program.arm())
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
