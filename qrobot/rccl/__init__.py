"""RCCL in Python: an arm programmed with the calls of the papers (Hayward & Paul 1986), as far as they exist yet.

    from qrobot import rccl

    with rccl.control("puma560") as arm:
        arm.move(arm.pose("park"))
        arm.waitfor(arm.completed)

`control` returns a `Channel`; its calls are also functions of this module, for the arm taken last, as in C, and so are
RCCL's global variables `completed`, `nbrequest`, `how` and `park`. Degrees (mm on a sliding joint) and milliseconds at
this boundary. Where the robot is, is chosen outside the program: `use` for
whoever starts it, else the variable QROBOT_BRIDGE ("host:port"), else the default port of this machine.
"""

from __future__ import annotations

from typing import Any

from qrobot.motion import Blend, Termination
from qrobot.rccl import program
from qrobot.rccl.channel import NO, YES, Channel
from qrobot.rccl.event import Event
from qrobot.rccl.position import Position
from qrobot.rccl.program import (
    CLOSE,
    OPEN,
    control,
    jposition,
    move,
    nextmove,
    pose,
    release,
    setime,
    setjvel,
    setmode,
    stop,
    use,
    waitas,
    waitfor,
)

__all__ = [
    "CLOSE",
    "NO",
    "OPEN",
    "YES",
    "Blend",
    "Channel",
    "Event",
    "Position",
    "Termination",
    "control",
    "jposition",
    "move",
    "nextmove",
    "pose",
    "release",
    "setime",
    "setjvel",
    "setmode",
    "stop",
    "use",
    "waitas",
    "waitfor",
]


def __getattr__(name: str) -> Any:
    """RCCL's global variables: those of the arm in use at this moment, so they are no names one could import."""
    if name in program.VARIABLES:
        return program.VARIABLES[name](program.arm())
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
