"""Teaching by commands: move the arm in world or tool coordinates, record where it is, go back there.

Made of the library's own calls, as in Hayward & Paul 1986, section 4.2: what is recorded is measured by `update`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from qrobot.errors import ConfigError, LinkError, MotionError, QRobotError, ServoFault
from qrobot.motion import Termination
from qrobot.motion.limits import Floats
from qrobot.rccl.channel import Channel
from qrobot.rccl.database import DataBase
from qrobot.rccl.parameters import small_move
from qrobot.rccl.position import EQ, TL, Position, makeposition
from qrobot.rccl.trace import reason_of
from qrobot.rccl.transforms import Transform, newtrans, t6
from qrobot.units import MM_PER_M

SETTLING_MS: Final = 150.0  # the last setpoints are still under way when a motion is completed
HELP: Final = """\
world dx 10 rz 5   move by mm (dx dy dz) and degrees (rx ry rz) along the axes of the base
tool dz -10        the same along the axes of the last link
record NAME        put where the arm is into the data base
move NAME          go to what was recorded
list               names that were recorded
where              where the arm is
park               go to the park pose
open, close        the hand
help, quit"""


class Teacher:
    """The interpreter.

    Args:
        arm: under control, at rest.
        database: where positions are recorded.

    Attributes:
        over: `quit` was said.
    """

    def __init__(self, arm: Channel, database: DataBase) -> None:
        self.over = False
        self._arm = arm
        self._database = database
        self._commands: dict[str, Callable[[list[str]], str]] = {
            "world": lambda words: self._step(words, in_world=True),
            "tool": lambda words: self._step(words, in_world=False),
            "record": self._record,
            "move": lambda words: self._go(_position(self._database.get(_name(words)))),
            "list": lambda _: "\n".join(self._database.names()) or "nothing recorded yet",
            "where": lambda _: _place(self._measure("HERE").value),
            "park": lambda _: self._go(self._arm.pose("park")),
            "open": lambda _: self._hand(self._arm.OPEN),
            "close": lambda _: self._hand(self._arm.CLOSE),
            "help": lambda _: HELP,
            "quit": lambda _: self._quit(),
        }

    def obey(self, line: str) -> str:
        """Do what a line says; what is to be answered. What stands behind a # is a comment.

        Mistakes and motions that cannot be done are answered, they end nothing.

        Raises:
            LinkError, ServoFault: the arm is lost.
        """
        words = line.partition("#")[0].split()
        if not words:
            return ""
        command = self._commands.get(words[0])
        if command is None:
            return f"error: unknown command {words[0]!r}; try help"
        try:
            return command(words[1:])
        except (LinkError, ServoFault):
            raise
        except QRobotError as error:
            return f"error: {error}"

    def _step(self, words: list[str], in_world: bool) -> str:
        step = _small_move(words)
        goal = self._measure("GOAL")
        value = goal.value @ step
        if in_world:
            value[:3, :3] = step[:3, :3] @ goal.value[:3, :3]
            value[:3, 3] = goal.value[:3, 3] + step[:3, 3]
        goal.set(value)
        return self._go(_position(goal))

    def _measure(self, name: str) -> Transform:
        """Where the arm is, by `update`."""
        here = newtrans(name)
        self._arm.update(here, _position(here))
        self._arm.move(self._arm.there)
        self._arm.waitfor(self._arm.completed)
        return here

    def _record(self, words: list[str]) -> str:
        here = self._measure(_name(words))
        self._database.record(here)
        return f"recorded {here.name}: {_place(here.value)}"

    def _go(self, position: Position) -> str:
        self._arm.move(position)
        self._arm.waitfor(self._arm.completed)
        settled = self._arm.time + SETTLING_MS
        self._arm.waitas(lambda: self._arm.time >= settled)
        if position.code != Termination.COMPLETED:
            raise MotionError(f"the motion to {position.name} ended early: {reason_of(position.code)}")
        return _place(self._measure("HERE").value)

    def _hand(self, act: Callable[[], None]) -> str:
        act()
        return "done"

    def _quit(self) -> str:
        self.over = True
        return ""


def _position(trsf: Transform) -> Position:
    return makeposition(trsf.name, t6, EQ, trsf, TL, trsf)


def _name(words: list[str]) -> str:
    if len(words) != 1:
        raise ConfigError("say one name")
    return words[0]


def _small_move(words: list[str]) -> Floats:
    """The transform of "dx 10 rz 5"."""
    try:
        values = [float(word) for word in words[1::2]]
    except ValueError:
        values = []
    if not words or len(words) != 2 * len(values) or not np.isfinite(values).all():
        raise MotionError("say directions and how far, as in: dx 10 rz 5 (mm and degrees)")
    return small_move(" ".join(words[::2]), tuple(values))


def _place(value: Floats) -> str:
    x, y, z = value[:3, 3] * MM_PER_M
    return f"at {x:.1f} {y:.1f} {z:.1f} mm"
