"""Errors as events for one handler of the program (Corke & Kirkham, section 2.6)."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeAlias

from qrobot.arcl.events import ArclEvent, CallbackAnswer
from qrobot.errors import MotionError, QRobotError

if TYPE_CHECKING:
    from qrobot.arcl.robot import ArclRobot

ErrorProcedure: TypeAlias = Callable[["ArclEvent", "ArclRobot", QRobotError], object]

_handler: list[ErrorProcedure] = []


def arcl_errproc(function: ErrorProcedure | None) -> None:
    """Let `function(event, rp, error)` decide what becomes of errors; None lets ARCL decide again.

    It answers OK to go on with the next motion, or MOVE_STOP to bring the arm to an orderly halt: the arm stops on its
    path and nothing of what waits is done. Without a function there is a halt, and the error is raised at the
    program's next call.

    Raises:
        MotionError: it is no function.
    """
    if function is not None and not callable(function):
        raise MotionError(f"arcl_errproc: a function is needed, not {function!r}")
    _handler[:] = [] if function is None else [function]


def goes_on(event: ArclEvent, robot: ArclRobot, error: QRobotError) -> bool | None:
    """Ask the program's function: true to go on; None when there is no function."""
    if not _handler:
        return None
    return answer_of(_handler[0](event, robot, error)) is CallbackAnswer.OK


def answer_of(given: object) -> CallbackAnswer:
    """Read the answer of a call-back. Raises MotionError: it is none."""
    if given is None:
        return CallbackAnswer.OK
    if isinstance(given, int) and not isinstance(given, bool) and given in set(CallbackAnswer):
        return CallbackAnswer(given)
    raise MotionError(f"a call-back answers OK, ERROR, MOVE_STOP or nothing, not {given!r}")
