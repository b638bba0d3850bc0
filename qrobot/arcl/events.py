"""The numbers that a program and its call-backs exchange. Never renumber, only add: a C program is compiled with them.

EVENT_DEQ, EVENT_DONE, OK, MOVE_STOP and the gripper's commands are the paper's names, the others ours [A].
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final


class ArclEvent(IntEnum):
    """The events for which a MOV_NOTIFY function, or the error handler, is called."""

    EVENT_DEQ = 1  # the motion is taken out of the queue; the function may refuse with MOVE_STOP
    EVENT_BEGIN = 2  # the transition into it begins
    EVENT_NEAR = 3  # it is nearly complete: the transition out of it is due
    EVENT_DONE = 4  # it is complete: its goal is reached, or passed in the middle of a transition
    EVENT_STOP = 5  # it ends before that: stopped, interrupted, or dropped from the queue
    EVENT_LIMIT = 6  # error: a joint would leave its range, or the arm come too near a fence
    EVENT_REACH = 7  # error: the goal, or a place on the way, is out of the arm's reach
    EVENT_SINGULAR = 8  # error: the way leads too close to a singularity
    EVENT_FAST = 9  # error: a joint would be too fast, as when a frame jumps
    EVENT_FAULT = 10  # error: control of the arm is lost
    EVENT_ERROR = 11  # any other error


class CallbackAnswer(IntEnum):
    """The answer of a call-back; None counts as OK."""

    OK = 0
    ERROR = -1
    MOVE_STOP = 1  # to EVENT_DEQ: not now; to an error: bring the arm to an orderly halt


class Grip(IntEnum):
    """Commands of the gripper."""

    GRIP_OPEN = 1
    GRIP_CLOSE = 2
    GRIP_CLOSE_BY = 3
    GRIP_OPEN_BY = 4
    GRIP_RELAX = 5


EVENT_DEQ: Final = ArclEvent.EVENT_DEQ
EVENT_BEGIN: Final = ArclEvent.EVENT_BEGIN
EVENT_NEAR: Final = ArclEvent.EVENT_NEAR
EVENT_DONE: Final = ArclEvent.EVENT_DONE
EVENT_STOP: Final = ArclEvent.EVENT_STOP
EVENT_LIMIT: Final = ArclEvent.EVENT_LIMIT
EVENT_REACH: Final = ArclEvent.EVENT_REACH
EVENT_SINGULAR: Final = ArclEvent.EVENT_SINGULAR
EVENT_FAST: Final = ArclEvent.EVENT_FAST
EVENT_FAULT: Final = ArclEvent.EVENT_FAULT
EVENT_ERROR: Final = ArclEvent.EVENT_ERROR
OK: Final = CallbackAnswer.OK
ERROR: Final = CallbackAnswer.ERROR
MOVE_STOP: Final = CallbackAnswer.MOVE_STOP
GRIP_OPEN: Final = Grip.GRIP_OPEN
GRIP_CLOSE: Final = Grip.GRIP_CLOSE
GRIP_CLOSE_BY: Final = Grip.GRIP_CLOSE_BY
GRIP_OPEN_BY: Final = Grip.GRIP_OPEN_BY
GRIP_RELAX: Final = Grip.GRIP_RELAX
