"""The value of a transform that is what a program in C says in its fields, for each library's class of transforms."""

from __future__ import annotations

from typing import Any

from qrobot.arrays import Floats
from qrobot.c_transport.memory import SharedPose


class SharedValue:
    """Stands before a library's class of transforms, whose value it replaces.

    Attributes:
        _pose: fields of the program, set before the transform is made.
        _function: of a functional transform, None for others.
    """

    _pose: SharedPose
    _function: Any

    @property
    def value(self) -> Floats:
        """The newest value. Shape (4, 4)."""
        return self._pose.value

    @value.setter
    def value(self, value: Floats) -> None:
        self._pose.value = value

    def part(self) -> None:
        """The program frees its memory: keep the value for motions under way, and call its function no more."""
        self._pose.part()
        if self._function is not None:
            self._function = _leave_it


def _leave_it(_: object) -> None:
    pass
