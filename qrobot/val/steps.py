"""The effect of each action of a line. One that takes time is a generator of what it waits for."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from qrobot.errors import ProgramError
from qrobot.val import flow_steps, manner_steps, motion_steps, tree, value_steps
from qrobot.val.task import ValTask, Waits
from qrobot.val.vocabulary import MOVING, moves_nothing

if TYPE_CHECKING:
    from qrobot.val.interpreter import Interpreter

_WORDS: Final[dict[str, Callable[..., Waits | None]]] = (
    motion_steps.WORDS | manner_steps.WORDS | value_steps.WORDS | flow_steps.WORDS
)
_ACTIONS: Final[dict[type, Callable[..., Waits | None]]] = (
    manner_steps.ACTIONS | value_steps.ACTIONS | flow_steps.ACTIONS
)


def is_motion(action: tree.StepAction | None) -> bool:
    """Whether an action is a motion of the arm, for which a speed or a configuration may have been asked."""
    return isinstance(action, tree.Instruction) and action.word in motion_steps.MOTIONS


def do_step(run: Interpreter, task: ValTask, action: tree.StepAction) -> Waits | None:
    """Begin an action; what it waits for, None for nothing. Raises ProgramError, MotionError."""
    if isinstance(action, tree.Instruction):
        if action.word in MOVING and not task.moves:
            raise ProgramError(moves_nothing(action.word))
        return _WORDS[action.word](run, task, *action.arguments)
    return _ACTIONS[type(action)](run, task, action)
