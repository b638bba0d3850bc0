"""The objects of a program in C, by their places in the memory that it shares with its engine."""

from __future__ import annotations

from threading import Lock
from typing import Any, Final

from qrobot.arcl.motion import Motion
from qrobot.arcl.trans import Trans
from qrobot.c_transport.memory import ProgramMemory, SharedPose
from qrobot.c_transport.shared_value import SharedValue
from qrobot.errors import MotionError
from qrobot.motion import TransformKind

_FIELDS: Final = 8  # of a transform: its numbers, behind the pointer to its name
_T0: Final = 8  # of a motion
_CODE: Final = 16


class CTrans(SharedValue, Trans):
    """A transform whose value is what the program's fields say.

    Args:
        name, kind, function: as of `Trans`.
        pose: in the program's memory.
    """

    def __init__(self, name: str, kind: TransformKind, pose: SharedPose, function: Any = None) -> None:
        self._pose = pose
        super().__init__(name, kind, function=function)


class ObjectTable:
    """All objects of one program.

    Args:
        memory: of the program.
    """

    def __init__(self, memory: ProgramMemory) -> None:
        self._memory = memory
        self._objects: dict[int, Any] = {}
        self._places: dict[int, int] = {}  # by identity
        self._motions: dict[int, Motion] = {}
        self._showing = Lock()  # the motions are shown by the calls of the program, and at samples

    def put(self, place: int, thing: Any) -> None:
        """Something is at a place from now on."""
        self._forget(place)
        self._objects[place] = thing
        self._places[id(thing)] = place

    def put_trans(self, place: int, trans: Trans, function: Any = None) -> CTrans:
        """A transform at a place, of the name, kind and value of `trans`; gives that of the program."""
        shared = CTrans(trans.name, trans.kind, SharedPose(self._memory.doubles(place + _FIELDS, 12)), function)
        shared.value = trans.value
        self.put(place, shared)
        return shared

    def put_motion(self, place: int, motion: Motion) -> None:
        """A motion at a place, whose fields are shown from now on."""
        self.put(place, motion)
        with self._showing:
            self._motions[place] = motion

    def get(self, call: str, place: int) -> Any:
        """The object at a place. Raises MotionError: there is none."""
        if place not in self._objects:
            raise MotionError(f"{call}: a pointer leads to no object that ARCL has made, or to one that was freed")
        return self._objects[place]

    def at(self, place: int) -> Any:
        """The object at a place; None for plain numbers."""
        return self._objects.get(place)

    def free(self, place: int) -> None:
        """Its memory will be used again."""
        if isinstance(thing := self._objects.get(place), CTrans):
            thing.part()
        self._forget(place)

    def place_of(self, thing: Any) -> int:
        """Place of an object; -1 for what is the engine's alone."""
        return self._places.get(id(thing), -1)

    def show_motions(self) -> None:
        """Write into the program's motions what has become of them."""
        with self._showing:
            for place, motion in list(self._motions.items()):
                code = motion.code  # once: it may get one meanwhile
                self._memory.doubles(place + _T0, 1)[0] = motion.t0
                self._memory.ints(place + _CODE)[0] = code or 0
                if code is not None:
                    del self._motions[place]

    def _forget(self, place: int) -> None:
        if place in self._objects:
            del self._places[id(self._objects.pop(place))]
            with self._showing:
                self._motions.pop(place, None)
