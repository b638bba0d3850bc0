"""Things that cross between a program and the process of its generator: copies, but for what both have to know.

| is | crosses as |
|---|---|
| a transform | the number of its cell in shared memory; T6 as itself; one with a function not at all |
| a position, a request | its number: whose fields tell how a motion goes, and what events are about |
| the drift of compliant axes | the generator's own, one for all motions of the arm |
"""

from __future__ import annotations

import io
import pickle
from collections import deque
from collections.abc import Callable
from typing import Any, Final
from weakref import WeakKeyDictionary, WeakValueDictionary, finalize

from qrobot.errors import MotionError
from qrobot.motion import T6, Compliance, Drift, Goal, MoveRequest, TransformKind, Trsf
from qrobot.motion.request import HERE
from qrobot.rccl.position import Position
from qrobot.rccl.process.shared_values import CELLS, ValueCells

_T6: Final = ("T6",)
_DRIFT: Final = ("drift",)


class ProgramEnd:
    """The program's end: it numbers its transforms, positions and requests.

    Args:
        values: of the transforms.
        part: tells the other end that transforms are gone, by their numbers, and waits until it knows.
    """

    def __init__(self, values: ValueCells, part: Callable[[list[int]], object]) -> None:
        self._values, self._part = values, part
        self._cells: WeakKeyDictionary[Trsf, int] = WeakKeyDictionary()
        self._free = list(range(CELLS))
        self._gone: deque[int] = deque()  # cells of transforms that nobody has any more
        self._positions: WeakKeyDictionary[Position, int] = WeakKeyDictionary()
        self._requests: dict[int, MoveRequest] = {}
        self._count = 0

    def dumps(self, what: object) -> bytes:
        """Bytes for the other end. Raises MotionError: a function that would have to be called there."""
        buffer = io.BytesIO()
        _Pickler(buffer, self._name).dump(what)
        return buffer.getvalue()

    def loads(self, data: bytes) -> Any:
        """Read what the other end has sent."""
        return _Unpickler(io.BytesIO(data), lambda name: self.request(name[1])).load()

    def number(self, request: MoveRequest) -> int:
        """A number for a request, under which both ends know it from now on."""
        self._count += 1
        self._requests[self._count] = request
        return self._count

    def request(self, number: int) -> MoveRequest | None:
        """The request of that number; None when nothing is to be heard of it any more."""
        return self._requests.get(number)

    def forget(self, number: int) -> None:
        """Forget a request that was refused or of which no report will come any more."""
        self._requests.pop(number, None)

    def _name(self, thing: object) -> tuple[Any, ...] | None:
        if isinstance(thing, Trsf):
            return _T6 if thing is T6 else self._name_transform(thing)
        if isinstance(thing, Position):
            if thing not in self._positions:
                self._count += 1
                self._positions[thing] = self._count
            return "position", self._positions[thing], thing.name
        return _DRIFT if isinstance(thing, Drift) else None

    def _name_transform(self, trsf: Trsf) -> tuple[Any, ...]:
        if trsf.kind is TransformKind.FUNCTION:
            raise MotionError(
                f"transform {trsf.name} has a function, which the generator's process cannot call: make it variable "
                'and change its value, or take control with processor="host"'
            )
        if trsf not in self._cells:
            self._cells[trsf] = number = self._new_cell(trsf.name)
            trsf.share(self._values.cell(number))
            finalize(trsf, self._gone.append, number).atexit = False
        return "transform", self._cells[trsf], trsf.name, trsf.kind

    def _new_cell(self, name: str) -> int:
        if not self._free:
            gone = [self._gone.popleft() for _ in range(len(self._gone))]
            self._part(gone)
            self._free = gone
        if not self._free:
            raise MotionError(
                f"transform {name}: motions name {CELLS} transforms already, and there is room for no more"
            )
        return self._free.pop()


class GeneratorEnd:
    """The generator's end: it has a twin of each transform and position, and the requests themselves.

    Args:
        values: of the transforms.
    """

    def __init__(self, values: ValueCells) -> None:
        self._values = values
        self._transforms: WeakValueDictionary[int, Trsf] = WeakValueDictionary()
        self._positions: WeakValueDictionary[int, Position] = WeakValueDictionary()
        self._numbers: WeakKeyDictionary[MoveRequest, int] = WeakKeyDictionary()
        self._drift = Drift()

    def dumps(self, what: object) -> bytes:
        """Bytes for the other end."""
        buffer = io.BytesIO()
        _Pickler(buffer, self._name).dump(what)
        return buffer.getvalue()

    def loads(self, data: bytes) -> Any:
        """Read what the other end has sent."""
        return _Unpickler(io.BytesIO(data), self._find).load()

    def know(self, number: int, request: MoveRequest) -> None:
        """Both ends know a request by that number."""
        self._numbers[request] = number

    def number_of(self, request: MoveRequest) -> int:
        """The number of a request."""
        return self._numbers[request]

    def part(self, numbers: list[int]) -> None:
        """Transforms are gone in the program: motions under way keep their values."""
        for number in numbers:
            if (trsf := self._transforms.pop(number, None)) is not None:
                trsf.part()

    def _name(self, thing: object) -> tuple[Any, ...] | None:
        return ("request", self._numbers[thing]) if isinstance(thing, MoveRequest) else None

    def _find(self, name: tuple[Any, ...]) -> object:
        match name:
            case ("T6",):
                return T6
            case ("drift",):
                return self._drift
            case ("position", number, text):
                return self._positions.setdefault(number, Position(text, HERE))
            case ("transform", number, text, kind):
                return self._transform(number, text, kind)
        raise MotionError(f"nothing here has the name {name}")

    def _transform(self, number: int, name: str, kind: TransformKind) -> Trsf:
        if (twin := self._transforms.get(number)) is None:
            twin = self._transforms[number] = Trsf(name, kind)
            twin.share(self._values.cell(number), ours=False)
        return twin


class _Pickler(pickle.Pickler):
    def __init__(self, buffer: io.BytesIO, name: Callable[[object], tuple[Any, ...] | None]) -> None:
        super().__init__(buffer, pickle.HIGHEST_PROTOCOL)
        self._name = name

    def persistent_id(self, obj: object) -> tuple[Any, ...] | None:
        """Name of a thing that both ends know."""
        return self._name(obj)

    def reducer_override(self, obj: Any) -> Any:
        """Reduce a goal to its products, a compliance to what it was made of."""
        if type(obj) is Goal:
            return Goal, (obj.name, obj.left, obj.right, None, obj.compliance)
        if type(obj) is Compliance:
            return Compliance, (obj.wrench, obj.axes, obj.drift)
        return NotImplemented


class _Unpickler(pickle.Unpickler):
    def __init__(self, buffer: io.BytesIO, find: Callable[[tuple[Any, ...]], object]) -> None:
        super().__init__(buffer)
        self._find = find

    def persistent_load(self, pid: tuple[Any, ...]) -> object:
        """The thing of that name."""
        return self._find(pid)
