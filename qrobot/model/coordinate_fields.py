"""Fields x, y and z of three numbers, for the vectors that programs read and write in place."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator


class CoordinateFields(ABC):
    """Three numbers by index and by the names x, y and z. Whose they are, and their unit, is the subclass's."""

    __slots__ = ()

    @abstractmethod
    def __getitem__(self, row: int) -> float:
        """One of the numbers."""

    @abstractmethod
    def __setitem__(self, row: int, number: float) -> None:
        """Write one of the numbers."""

    def __iter__(self) -> Iterator[float]:
        return iter([self[row] for row in range(3)])

    @property
    def x(self) -> float:
        """First coordinate."""
        return self[0]

    @x.setter
    def x(self, number: float) -> None:
        self[0] = number

    @property
    def y(self) -> float:
        """Second coordinate."""
        return self[1]

    @y.setter
    def y(self, number: float) -> None:
        self[1] = number

    @property
    def z(self) -> float:
        """Third coordinate."""
        return self[2]

    @z.setter
    def z(self, number: float) -> None:
        self[2] = number
