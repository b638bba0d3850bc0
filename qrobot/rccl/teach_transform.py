"""RCCL's `teach`: a program that lacks the value of a transform lets a person show it.

The dialogue is that of RCCL 1.0: its banner, a question mark for each command, `q` to go on with the program, `q!` to
go on without. It has the purpose and the arguments of `update`, and is made of it (Hayward & Paul 1986, section 4.2).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from qrobot.rccl.channel import NO, YES, Channel
from qrobot.rccl.database import DataBase
from qrobot.rccl.jog import STEPPING_HELP, Stepper, place
from qrobot.rccl.position import Position
from qrobot.rccl.transforms import Transform

PROMPT: Final = "? "
LESSON_HELP: Final = f"""\
{STEPPING_HELP}
record             take where the arm is; only the last record counts
q                  go on with the program
q!                 go on, and leave the transform as it was"""

Prompt = Callable[[str], str]
Say = Callable[[str], object]


class Lesson(Stepper):
    """The interpreter of one `teach`.

    Args:
        arm: under control, at rest.
        trans: to be found out.
        position: whose equation names it.
        ask: a question in, a line out.

    Attributes:
        recorded: the transform has a value that counts.
    """

    def __init__(self, arm: Channel, trans: Transform, position: Position, ask: Prompt) -> None:
        super().__init__(arm)
        self.recorded = False
        self._trans, self._position, self._ask = trans, position, ask
        self._commands |= {
            "record": lambda _: self._record(),
            "help": lambda _: LESSON_HELP,
            "q": lambda _: self._leave(),
            "q!": lambda _: self._forget(),
        }

    def _record(self) -> str:
        self._record_into(self._trans, self._position)
        self.recorded = True
        return f"recorded {self._trans.name}: {place(self._trans.value)}"

    def _leave(self) -> str:
        if self.recorded or said_yes(self._ask, "nothing taught, exit ? (y/n) "):
            self.over = True
        return ""

    def _forget(self) -> str:
        self.recorded = False
        return self._quit()


def teach(
    arm: Channel,
    trans: Transform,
    position: Position,
    database: DataBase | None = None,
    ask: Prompt = input,
    say: Say = print,
) -> int:
    """Let a person move `arm` and record the value of `trans` that makes the equation of `position` true there.

    A transform that `database` has is read from it, and nobody asked; one that it lacks can be saved there.

    Args:
        arm: under control.
        trans: as in `Channel.update`.
        position: as in `Channel.update`.
        database: where to look first.
        ask, say: the terminal.

    Returns:
        YES when the transform has its value, NO when nothing was recorded: then it is as before.

    Raises:
        MotionError: the position has no equation, or that does not name the transform once.
        ConfigError: the data base cannot be read or written.
        LinkError, ServoFault: the arm is lost.
    """
    if database is not None and database.read(trans):
        return YES
    arm.check_update(trans, position)  # better refused now than when everything is in place
    before = trans.value.copy()
    say(f"teach mode V1.0, transform {trans.name}, position {position.name}")
    if not _lesson(Lesson(arm, trans, position, ask), ask, say):
        trans.set(before)
        return NO
    if database is not None and said_yes(ask, f"save {trans.name} ? (y/n) "):
        database.record(trans)
    return YES


def _lesson(lesson: Lesson, ask: Prompt, say: Say) -> bool:
    """True when something was recorded; the end of the input is as good as `q`."""
    try:
        while not lesson.over:
            if answer := lesson.obey(ask(PROMPT)):
                say(answer)
    except EOFError:
        pass
    return lesson.recorded


def said_yes(ask: Prompt, question: str) -> bool:
    """The answer begins with y; the end of the input is no answer."""
    try:
        return ask(question).strip().lower().startswith("y")
    except EOFError:
        return False
