"""Functions of a program in C that ARCL calls: their arguments and answers lie in shared memory (`struct cell`)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from qrobot.arcl.c.objects import ObjectTable
from qrobot.arcl.events import ArclEvent
from qrobot.arcl.machine.bridge import SAMPLED
from qrobot.arcl.motion import Motion, MotionFeedback
from qrobot.arcl.opened import open_robots
from qrobot.arcl.robot import ArclRobot
from qrobot.arcl.trace_output import settle
from qrobot.arcl.trans import Trans
from qrobot.c_transport.memory import ProgramMemory
from qrobot.c_transport.message import TEXT, Op

_WORDS: Final = 5  # form, function, first, second, answer
_TIME: Final = 8 * _WORDS
_TEXT: Final = _TIME + 8
_FEEDBACK: Final = _TEXT + TEXT
_JOINTS: Final = 32
_OF_TRANSFORM, _OF_EVENT, _OF_END, _OF_FEEDBACK, _OF_ERROR, _OF_PREDICATE, _OF_PLACE = range(1, 8)
_NOWHERE: Final = -1


class FunctionCell:
    """The place where functions of one program find their arguments.

    Args:
        memory: of the program.
        place: of the cell.
        objects: of the program.
        call: has a function called.
    """

    def __init__(
        self, memory: ProgramMemory, place: int, objects: ObjectTable, call: Callable[[Op, int], None]
    ) -> None:
        self._words = memory.words(place, _WORDS)
        self._time = memory.doubles(place + _TIME, 1)
        self._text = memory.text(place + _TEXT, TEXT)
        self._feedback = memory.doubles(place + _FEEDBACK, 3 + 4 * _JOINTS)
        self._objects, self._call = objects, call

    def function(self, address: int, silent: bool) -> CFunction:
        """A function of the program, which returns nothing if `silent`."""
        return CFunction(self, address, silent)

    def call(self, address: int, given: tuple[Any, ...]) -> int:
        """Call it with what ARCL hands to a function of its kind; what it returns."""
        settle()  # traces stand before what the function prints
        with SAMPLED:  # arms have threads of their own, and the function may tell any arm something
            form, first, second = self._arguments(given)
            self._words[:4] = form, address, first, second
            robots = open_robots()
            self._time[0] = robots[-1].treal if robots else 0.0
            self._objects.show_motions()
            self._call(Op.CALL_ARCL, 0)
            return int(self._words[4])

    def _arguments(self, given: tuple[Any, ...]) -> tuple[int, int, int]:
        match given:
            case ():
                return _OF_PREDICATE, 0, 0
            case (MotionFeedback() as told,):
                self._show(told)
                return _OF_FEEDBACK, 0, 0
            case (Trans() | ArclRobot() as first, second):
                return self._of_objects(first, second)
            case (ArclEvent() as event, robot):
                return _OF_EVENT, int(event), self._objects.place_of(robot)
            case (event, robot, error):
                self._say(str(error))
                return _OF_ERROR, int(event), self._objects.place_of(robot)
        raise TypeError(f"no function of C is called with {given!r}")

    def _of_objects(self, first: Trans | ArclRobot, second: Motion | ArclRobot | None) -> tuple[int, int, int]:
        place = self._objects.place_of(first)
        if isinstance(second, ArclRobot):
            return _OF_PLACE, place, self._objects.place_of(second)
        return _OF_TRANSFORM if isinstance(first, Trans) else _OF_END, place, self._motion(second)

    def _motion(self, motion: Motion | None) -> int:
        return _NOWHERE if motion is None else self._objects.place_of(motion)

    def _say(self, text: str) -> None:
        data = text.encode()[: TEXT - 1]
        self._text[:] = 0
        self._text[: len(data)] = np.frombuffer(data, np.uint8)

    def _show(self, told: MotionFeedback) -> None:
        n = told.joints.size
        self._feedback[:3] = told.t, told.share, n
        rows = self._feedback[3:].reshape(4, _JOINTS)
        rows[:, :n] = told.joints, told.rates, told.setpoint, told.torque


class CFunction:
    """A function of the program, called as one in Python.

    Args:
        cell: where its arguments go.
        address: in the program.
        silent: it returns nothing.
    """

    def __init__(self, cell: FunctionCell, address: int, silent: bool) -> None:
        self._cell, self._address, self._silent = cell, address, silent

    def __call__(self, *given: Any) -> int | None:
        """Have it called; what it answers."""
        answer = self._cell.call(self._address, given)
        return None if self._silent else answer

    def __repr__(self) -> str:
        return "a function of the program"
