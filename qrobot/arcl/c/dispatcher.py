"""Dispatcher of the calls of a C program that includes `<arcl.h>`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from qrobot.arcl.c.calls import CALLS, GIVING_WAY, WAITING, check_values
from qrobot.arcl.c.cell import FunctionCell
from qrobot.arcl.c.objects import ObjectTable
from qrobot.arcl.c.values import CallArguments
from qrobot.arcl.program import end_all
from qrobot.arcl.trace_output import settle
from qrobot.c_transport.memory import ProgramMemory
from qrobot.c_transport.message import CallMessage, Op
from qrobot.c_transport.program_link import ProgramLink
from qrobot.errors import MotionError, QRobotError
from qrobot.rci.listening import giving_way

CELL: Final = 15  # where the greeting names the place of the cell


class ArclDispatcher:
    """Serves one program.

    Args:
        memory: shared with the program.
        places: that its greeting names.
        link: to the program.
    """

    def __init__(self, memory: ProgramMemory, places: Sequence[int], link: ProgramLink) -> None:
        self._objects = ObjectTable(memory)
        self._cell = FunctionCell(memory, places[CELL], self._objects, link.call)
        self._words: list[str] = []
        self._others_wait = link.others_wait

    def answer(self, message: CallMessage, background: bool = False) -> CallMessage:
        """See `CallDispatcher.answer`."""
        if message.op == Op.ARCL_WORD:
            self._words[message.n :] = [message.text]
            return CallMessage(Op.REPLY)
        if message.op == Op.RELEASE:
            end_all(well=bool(message.n))
            return self._told(None)
        arguments = CallArguments(message, self._words, self._objects.get, self._cell.function)
        if background and arguments.call in WAITING:
            raise MotionError(f"{arguments.call}: a function that ARCL calls must not wait, nor open or close a robot")
        check_values(arguments.call, given := list(arguments))
        if arguments.call not in GIVING_WAY:
            return self._told(CALLS[arguments.call](self._objects, arguments.result, given))
        with giving_way(self._others_wait):
            return self._told(CALLS[arguments.call](self._objects, arguments.result, given))

    def _told(self, answer: CallMessage | None) -> CallMessage:
        """The answer, once the program can see what became of its motions, and traces before it are printed."""
        self._objects.show_motions()
        settle()
        return answer or CallMessage(Op.REPLY)

    def let_go(self) -> None:
        """See `CallDispatcher.let_go`."""
        try:
            end_all(well=False)
        except QRobotError:  # of a program that is not there any more
            return
