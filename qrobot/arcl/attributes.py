"""Attribute lists: `move(rp, pos, MOV_TRAJ, TRAJ_CART, MOV_TIME, 2000, 0)` (Corke & Kirkham, section 2.3).

A list names attributes, each followed by its values, and ends with 0 or None, or simply ends. The numbers are part of
the interface of C programs: never renumber, only add. Of the paper are ARCL_ARGCV, MOV_TRAJ, MOV_TIME, MOV_CONFIG,
MOV_SYNC, MOV_DONEPROC and MOV_NOTIFY; it says that there are "some 20 attributes" and names no more: the others are
ours [A].
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import Any, Final

from qrobot.errors import MotionError


class Attribute(IntEnum):
    """The name of an attribute."""

    ARCL_ARGCV = 1  # argc, argv: the command line, out of which the `+` switches are taken
    ARCL_ROBOT = 2  # name of a packaged robot, or path of a robot file
    ARCL_AMI = 3  # name of the machine layer
    ARCL_AKI = 4  # name of the kinematics layer
    ARCL_PERIOD = 5  # sample period, ms
    ARCL_STREAM = 6  # file of the diagnostic stream
    ARCL_START = 7  # off line: joint positions to begin at, degrees (mm)
    ARCL_CLEAR = 8  # clear a latched fault first
    ARCL_BRIDGE = 9  # "host:port" of the bridge of one of several arms
    MOV_TRAJ = 101  # sticky: TRAJ_JOINT or TRAJ_CART
    MOV_TIME = 102  # Tseg, ms
    MOV_TACC = 103  # sticky: Ta, ms, half the time of the transition into the motion
    MOV_VT = 104  # sticky: speed of the tool, mm/s; 0: as it goes with MOV_VR
    MOV_VR = 105  # sticky: turning speed of the tool, degrees/s; 0: as it goes with MOV_VT
    MOV_JVEL = 106  # sticky: speed of the fastest joint, degrees/s (mm/s)
    MOV_SHARE = 107  # sticky: of its own limit that the busiest joint uses, per cent
    MOV_CONFIG = 108  # configuration at the goal, as in "lun"
    MOV_SYNC = 109  # return when the motion is nearly complete
    MOV_DONEPROC = 110  # function called when it is complete
    MOV_NOTIFY = 111  # function called for each of its events
    MOV_FEEDBACK = 112  # function called at each of its samples; a true result ends it
    MOV_OFFSET = 113  # transform, in the frame of the tool, that modifies the goal
    MOV_UPDATE = 114  # transform to be solved for when it ends, with the measured T6
    MOV_NAME = 115  # name in traces


_VALUES: Final = {Attribute.ARCL_ARGCV: 2, Attribute.MOV_SYNC: 0, Attribute.ARCL_CLEAR: 0}
TRAJ_JOINT: Final = 1
TRAJ_CART: Final = 2

ARCL_ARGCV: Final = Attribute.ARCL_ARGCV
ARCL_ROBOT: Final = Attribute.ARCL_ROBOT
ARCL_AMI: Final = Attribute.ARCL_AMI
ARCL_AKI: Final = Attribute.ARCL_AKI
ARCL_PERIOD: Final = Attribute.ARCL_PERIOD
ARCL_STREAM: Final = Attribute.ARCL_STREAM
ARCL_START: Final = Attribute.ARCL_START
ARCL_CLEAR: Final = Attribute.ARCL_CLEAR
ARCL_BRIDGE: Final = Attribute.ARCL_BRIDGE
MOV_TRAJ: Final = Attribute.MOV_TRAJ
MOV_TIME: Final = Attribute.MOV_TIME
MOV_TACC: Final = Attribute.MOV_TACC
MOV_VT: Final = Attribute.MOV_VT
MOV_VR: Final = Attribute.MOV_VR
MOV_JVEL: Final = Attribute.MOV_JVEL
MOV_SHARE: Final = Attribute.MOV_SHARE
MOV_CONFIG: Final = Attribute.MOV_CONFIG
MOV_SYNC: Final = Attribute.MOV_SYNC
MOV_DONEPROC: Final = Attribute.MOV_DONEPROC
MOV_NOTIFY: Final = Attribute.MOV_NOTIFY
MOV_FEEDBACK: Final = Attribute.MOV_FEEDBACK
MOV_OFFSET: Final = Attribute.MOV_OFFSET
MOV_UPDATE: Final = Attribute.MOV_UPDATE
MOV_NAME: Final = Attribute.MOV_NAME


def attribute_values(call: str, given: Sequence[Any]) -> dict[Attribute, tuple[Any, ...]]:
    """The values of each attribute in a list. Raises MotionError: no attribute, one of another call, or no value."""
    found: dict[Attribute, tuple[Any, ...]] = {}
    words = list(given)
    while words and words[0] is not None and not (isinstance(words[0], int) and words[0] == 0):
        attribute = _attribute(call, words.pop(0))
        count = _VALUES.get(attribute, 1)
        if len(words) < count:
            raise MotionError(f"{call}: {attribute.name} needs {count} value{'s' if count > 1 else ''} behind it")
        found[attribute], words = tuple(words[:count]), words[count:]
    if len(words) > 1:
        extra = words[1].name if isinstance(words[1], Attribute) else repr(words[1])
        raise MotionError(f"{call}: {extra} stands behind the end of the list")
    return found


def _attribute(call: str, word: Any) -> Attribute:
    prefix = "ARCL_" if call == "arcl_open" else "MOV_"
    known = [attribute for attribute in Attribute if attribute.name.startswith(prefix)]
    if isinstance(word, int) and not isinstance(word, bool) and word in set(known):
        return Attribute(word)
    raise MotionError(f"{call}: {word!r} is no attribute; there are {', '.join(one.name for one in known)}")
