"""Transforms as terms of position equations: four kinds, told apart by when their value counts (Hayward & Paul 1986).

| kind | its value counts |
|---|---|
| constant | as it was when the motion was asked for; multiplied with its neighbours beforehand |
| variable | as it is at each sample: whoever changes it must keep the steps small |
| hold | as it was when the motion was asked for; one transform serves many motions with different values |
| functional | computed anew by its function at each sample, once, however often it occurs |
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import Enum
from typing import Any, Final, Protocol

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.model.transform import is_transform
from qrobot.realtime.jit import kernel

_TOLERANCE: Final = 1e-6  # as of `is_transform`


@kernel
def rigid(T: Floats) -> bool:
    """`is_transform(T)` for a (4, 4) array of float64, fast enough for every sample."""
    bottom = abs(T[3, 0]) + abs(T[3, 1]) + abs(T[3, 2]) + abs(T[3, 3] - 1.0)
    sound = bottom <= _TOLERANCE and abs(T[0, 3] + T[1, 3] + T[2, 3]) < math.inf
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        length = T[0, i] * T[0, i] + T[1, i] * T[1, i] + T[2, i] * T[2, i]
        sound = sound and abs(length - 1.0) <= _TOLERANCE
        for row in range(3):  # each axis is the cross product of the two others
            up, down = (row + 1) % 3, (row + 2) % 3
            cross = T[up, j] * T[down, k] - T[down, j] * T[up, k]
            sound = sound and abs(cross - T[row, i]) <= _TOLERANCE
    return bool(sound)


def _sound(value: Floats) -> bool:
    plain = isinstance(value, np.ndarray) and value.shape == (4, 4) and value.dtype == np.float64
    return bool(rigid(np.ascontiguousarray(value))) if plain else is_transform(np.asarray(value))


class TransformKind(Enum):
    """Instants at which the value of a transform counts."""

    CONST = "const"
    VARB = "varb"
    HOLD = "hold"
    FUNCTION = "function"
    UNKNOWN = "unknown"  # what an equation is solved for


class ValuePlace(Protocol):
    """A place that another process sees too, for the value of a transform."""

    def get(self) -> Floats:
        """The newest value, not to be written to. Shape (4, 4)."""

    def set(self, value: Floats) -> None:
        """Give it another value in one step. Shape (4, 4)."""


class Trsf:
    """A term: the pose of one frame in another, or a motion of the first.

    Args:
        name: for traces and messages.
        kind: when its value counts.
        value: pose, shape (4, 4), m; default identity. Copied.
        function: of a functional transform; called with the transform, whose `value` it changes.

    Raises:
        MotionError: the value is no rigid transform, or a function is missing or too many.
    """

    def __init__(
        self,
        name: str,
        kind: TransformKind = TransformKind.VARB,
        value: Floats | None = None,
        function: Callable[[Any], object] | None = None,
    ) -> None:
        if (kind is TransformKind.FUNCTION) != (function is not None):
            raise MotionError(f"transform {name}: a function belongs to a functional transform, and only there")
        self.name = name
        self.kind = kind
        self._place: ValuePlace | None = None
        self.value = np.eye(4)
        self._function = function
        self._age: int | None = None  # sample of the latest evaluation
        if value is not None:
            self.set(value)

    @property
    def value(self) -> Floats:
        """The newest value. Shape (4, 4)."""
        return self._value if self._place is None else self._place.get()

    @value.setter
    def value(self, value: Floats) -> None:
        if self._place is None:
            self._value = value
        else:
            self._place.set(value)

    def share(self, place: ValuePlace, ours: bool = True) -> None:
        """Let the value lie where another process sees it too: this one's, if it is `ours`, else what is there."""
        if ours:
            place.set(self.value)
        self._place = place

    def part(self) -> None:
        """Keep the value as it is now, whatever becomes of the place where it lay."""
        self._value, self._place = self.value.copy(), None

    def set(self, value: Floats) -> None:
        """Give it another value, shape (4, 4), in one step. Raises MotionError when that is no rigid transform."""
        value = np.array(value, dtype=np.float64)
        if not np.isfinite(value).all():
            raise MotionError(f"transform {self.name}: one of its numbers is not finite")
        self._check(value)
        self.value = value

    def check(self) -> None:
        """Raise MotionError when its value, which fields may have changed one by one, is no rigid transform."""
        self._check(self.value)

    def _check(self, value: Floats) -> None:
        if not _sound(value):
            raise MotionError(f"transform {self.name}: not a rigid transform: {np.round(value, 6).tolist()}")

    def at(self, tick: int) -> Floats:
        """The value at sample `tick`. Shape (4, 4).

        Raises:
            MotionError: a functional transform's function left something that is no rigid transform.
        """
        if self._function is not None and self._age != tick:
            self._function(self)
            self._age = tick
            if not _sound(self.value):
                raise MotionError(f"transform {self.name}: its function left no rigid transform: {self.value.tolist()}")
        return self.value

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r}, {self.kind.value})"


T6: Final = Trsf("T6", TransformKind.UNKNOWN)
"""The end of the arm in its base, the unknown of every position equation."""
