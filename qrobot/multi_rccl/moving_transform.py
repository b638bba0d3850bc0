"""The transform of a manipulator, which other equations may use: its value at each of the newest samples."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.motion import TransformKind
from qrobot.rccl import Transform
from qrobot.rccl.task_group import MOST_APART

KEPT: Final = 2 * MOST_APART  # samples: further than that no arm is behind another


class MovingTransform(Transform):
    """A manipulator's own transform (`&robot->trans`).

    Args:
        name: of it.
        owner: name of the manipulator.
        look: called with the number of a sample whose value is asked for, before it is given.
    """

    def __init__(self, name: str, owner: str, look: Callable[[int], object] = lambda _tick: None) -> None:
        super().__init__(name, TransformKind.FUNCTION, function=lambda _t: None)
        self._owner, self._look = owner, look
        self._values: dict[int, Floats] = {}

    def set(self, value: Floats) -> None:  # noqa: ARG002 (see Trsf)
        """Raise MotionError: where a manipulator is, its motions say."""
        raise MotionError(f"{self.name} is where {self._owner} is: move it, or copy the value with assigntr")

    def record(self, tick: int, value: Floats) -> None:
        """Its value at sample `tick`, the newest one. Shape (4, 4)."""
        self.value = value
        self._values[tick] = value
        while len(self._values) > KEPT:
            del self._values[next(iter(self._values))]

    def require_known(self) -> None:
        """Raise MotionError: the manipulator is not under control yet, so it is nowhere."""
        if not self._values:
            raise MotionError(f"{self._owner} is not under control; call rccl_control first")

    def at(self, tick: int) -> Floats:
        """The value at sample `tick`, or at the sample nearest to it that is known. Shape (4, 4).

        Raises:
            MotionError: the manipulator is not under control yet.
        """
        self._look(tick)
        if tick in self._values:
            return self._values[tick]
        self.require_known()
        return self._values[min(self._values, key=lambda known: abs(known - tick))]
