"""The arguments of a call of `<arcl.h>`, out of its message: each has a kind, and numbers, a text or a reference."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final

from qrobot.arcl.positions import EQ, TL
from qrobot.arcl.vectors import CartesianVector
from qrobot.c_transport.message import CallMessage
from qrobot.motion import T6

SEPARATOR: Final = "\x1f"
_MARKS: Final = {"E": EQ, "L": TL, "6": T6, "z": None}
_SIZES: Final = {"Q": 4, "D": 6, "W": 7}


class StrangeValue:
    """An argument of a type that no call takes."""

    def __repr__(self) -> str:
        return "something of another type"


class WordList(list[str]):
    """The words of a command line; their number goes before."""


class CallArguments:
    """The arguments of one call.

    Args:
        message: as it came.
        words: of the command line, which came before.
        object_at: the object at a place.
        function_at: a function of the program: its address, and whether it returns nothing.

    Attributes:
        call: its name.
        result: the place of the object that it makes.
    """

    def __init__(
        self,
        message: CallMessage,
        words: Sequence[str],
        object_at: Callable[[str, int], Any],
        function_at: Callable[[int, bool], Any],
    ) -> None:
        self.call, kinds, *texts = message.text.split(SEPARATOR)
        self.result, *refs = message.refs
        self._kinds, self._texts, self._refs = kinds, iter(texts), iter(refs)
        self._numbers = iter(message.numbers)
        self._words, self._object_at, self._function_at = words, object_at, function_at

    def __iter__(self) -> Iterator[Any]:
        return iter([self._value(kind) for kind in self._kinds])

    def _value(self, kind: str) -> Any:
        if kind in _MARKS:
            return _MARKS[kind]
        if kind in "id":
            number = next(self._numbers)
            return int(number) if kind == "i" else number
        if kind == "s":
            return next(self._texts)
        if kind == "o":
            return self._object_at(self.call, next(self._refs))
        if kind in "fv":
            return self._function_at(next(self._refs), kind == "v")
        return self._numbers_of(kind)

    def _numbers_of(self, kind: str) -> Any:
        if kind == "a":
            return WordList(self._words)
        if kind == "V":
            return CartesianVector(*self._take(3))
        if kind == "J":
            return self._take(int(next(self._numbers)))
        return self._take(_SIZES[kind]) if kind in _SIZES else StrangeValue()

    def _take(self, count: int) -> tuple[float, ...]:
        return tuple(next(self._numbers) for _ in range(count))
