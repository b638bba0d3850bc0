"""The transforms and position equations of a C program, by their places in the shared memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.c_transport.memory import ProgramMemory, numbers_of, value_of
from qrobot.c_transport.message import CallMessage, Op
from qrobot.errors import MotionError
from qrobot.model.transform import inverse
from qrobot.motion import TransformKind, Trsf
from qrobot.rccl import transforms
from qrobot.rccl.c.shared import SharedEvent, SharedPosition, SharedTransform
from qrobot.rccl.position import EQ, TL, Separator, Target, makeposition
from qrobot.rccl.transforms import Transform, t6, timed

_KINDS: Final = (
    TransformKind.FUNCTION,
    TransformKind.CONST,
    TransformKind.VARB,
    TransformKind.HOLD,
)  # numbered by newtrans
_WORDS: Final = {-2: EQ, -3: TL}
_MAKERS: Final[dict[str, Callable[..., Transform]]] = {
    "trsl": lambda px, py, pz: transforms.gentr_trsl("", px, py, pz),
    "rot": lambda px, py, pz, vx, vy, vz, a: transforms.gentr_rot("", px, py, pz, (vx, vy, vz), a),
    "eul": lambda *numbers: transforms.gentr_eul("", *numbers),
    "rpy": lambda *numbers: transforms.gentr_rpy("", *numbers),
    "pao": lambda *numbers: transforms.gentr_pao("", numbers[0:3], numbers[3:6], numbers[6:9]),
}


class UnknownError(MotionError):
    """A call was given something that is no object of ours."""


class ObjectRegistry:
    """Objects that one program has made.

    Args:
        memory: shared with the program.
        fields: where, within a transform, its numbers begin, and within a position its code, scal and end.
        last_link: the place of T6, and what is there.
        evaluate: has the function of the transform at a place called.
        signal: has the program count the event at a place.
    """

    def __init__(
        self,
        memory: ProgramMemory,
        fields: Sequence[int],
        last_link: tuple[int, SharedTransform],
        evaluate: Callable[[int], None],
        signal: Callable[[int], None],
    ) -> None:
        self._memory = memory
        self._axes, self._code, self._scal, self._end = fields
        self._t6 = last_link[1]
        self._evaluate, self._signal = evaluate, signal
        self._transforms: dict[int, SharedTransform] = dict([last_link])
        self._positions: dict[int, SharedPosition] = {}
        self._lent: dict[int, Trsf] = {}
        self._ours = {last_link[0]}  # not to be freed

    # ------------------------------------------------------------------------------------------------- transforms

    def newtrans(self, message: CallMessage) -> None:
        """A new one, at refs[0], of kind n."""
        place = message.refs[0]
        kind = _KINDS[message.n]
        function = None if kind is not TransformKind.FUNCTION else timed(lambda _: self._evaluate(place))
        fields = self._memory.reals(place + self._axes, 12)
        self._transforms[place] = SharedTransform(message.text, kind, fields, function)

    def freetrans(self, message: CallMessage) -> None:
        """Its memory will be used again."""
        self._may_go(message.refs[0])
        self.transform(message.refs[0]).part()
        del self._transforms[message.refs[0]]

    def make(self, message: CallMessage) -> CallMessage:
        """Another value for a transform, made by the constructor `text`."""
        return self._give(message.refs[0], _MAKERS[message.text](*message.numbers[: message.n]).value)

    def trmult(self, message: CallMessage) -> CallMessage:
        """A product."""
        return self._give(message.refs[2], self._operand(message, 0) @ self._operand(message, 1))

    def invert(self, message: CallMessage) -> CallMessage:
        """An inverse."""
        return self._give(message.refs[2], inverse(self._operand(message, 0)))

    def lend(self, place: int, trsf: Trsf) -> None:
        """A transform at `place` that is not the program's, which may use it and not change it."""
        self._lent[place] = trsf

    def transform(self, place: int) -> SharedTransform:
        """The one at `place`. Raises UnknownError."""
        if place not in self._transforms:
            raise UnknownError("this is no transform of newtrans or the gentr_ functions, or it was freed")
        return self._transforms[place]

    def _operand(self, message: CallMessage, i: int) -> Floats:
        place = message.refs[i]
        known = self._lent.get(place) or self._transforms.get(place)
        return value_of(np.array(message.numbers[12 * i : 12 * i + 12])) if known is None else known.value

    def _give(self, place: int, value: Floats) -> CallMessage:
        if place in self._lent:
            self._lent[place].set(value)
        if place in self._transforms:
            self._transforms[place].set(value)
        return CallMessage(Op.REPLY, numbers=numbers_of(value).tolist())

    # -------------------------------------------------------------------------------------------------- positions

    def makeposition(self, message: CallMessage) -> None:
        """The position at refs[0], of the n terms behind it."""
        terms = [self.term(place) for place in message.refs[1 : 1 + message.n]]
        self.put(message.refs[0], message.text, makeposition(message.text, *terms).target)

    def freepos(self, message: CallMessage) -> None:
        """Its memory will be used again."""
        self._may_go(message.refs[0])
        self.position(message.refs[0]).part()
        del self._positions[message.refs[0]]

    def put(self, place: int, name: str, target: Target, ours: bool = False) -> None:
        """A position at `place`; one of `ours` the program cannot free."""
        code = self._memory.ints(place + self._code)
        scal = self._memory.reals(place + self._scal, 1)
        at = place + self._end
        end = SharedEvent(f"{name}.end", self._memory.ints(at), lambda: self._signal(at))
        self._positions[place] = SharedPosition(name, target, code, scal, end)
        if ours:
            self._ours.add(place)

    def position(self, place: int) -> SharedPosition:
        """The one at `place`. Raises UnknownError."""
        if place not in self._positions:
            raise UnknownError("this is no position of makeposition or jposition, or it was freed")
        return self._positions[place]

    def term(self, place: int) -> Trsf | Separator:
        """The term of an equation that a message names so: a transform at that place, or EQ, TL or t6.

        Raises UnknownError: there is none.
        """
        if place in _WORDS:
            return _WORDS[place]
        if place in self._lent:
            return self._lent[place]
        trsf = self.transform(place)
        return t6 if trsf is self._t6 else trsf

    def _may_go(self, place: int) -> None:
        if place in self._ours:
            raise UnknownError("t6, park and there are not the program's to free")
