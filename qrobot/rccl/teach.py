"""Teaching by commands: move the arm, record where it is into a data base, go back there."""

from __future__ import annotations

from typing import Final

from qrobot.errors import ConfigError
from qrobot.rccl.channel import Channel
from qrobot.rccl.database import DataBase
from qrobot.rccl.jog import STEPPING_HELP, Stepper, fixed_position, place

HELP: Final = f"""\
{STEPPING_HELP}
record NAME        put where the arm is into the data base
move NAME          go to what was recorded
frame NAME dx 10   move along the axes of what was recorded
list               names that were recorded
help, quit"""


class Teacher(Stepper):
    """The interpreter of `qrobot teach`.

    Args:
        arm: under control, at rest.
        database: where positions are recorded.
    """

    def __init__(self, arm: Channel, database: DataBase) -> None:
        super().__init__(arm)
        self._database = database
        self._commands |= {
            "record": self._record,
            "move": self._move,
            "frame": self._step_along,
            "list": lambda _: "\n".join(self._database.names()) or "nothing recorded yet",
            "help": lambda _: HELP,
            "quit": lambda _: self._quit(),
        }

    def _step_along(self, words: list[str]) -> str:
        frame = self._database.get(_name(words[:1]))
        return self._step(words[1:], in_world=True, axes=frame.value[:3, :3])

    def _move(self, words: list[str]) -> str:
        taught = self._database.get(_name(words))
        return self._go(fixed_position(taught.name, taught.value))

    def _record(self, words: list[str]) -> str:
        here = self._measure(_name(words))
        self._database.record(here)
        return f"recorded {here.name}: {place(here.value)}"


def _name(words: list[str]) -> str:
    if len(words) != 1:
        raise ConfigError("say one name")
    return words[0]
