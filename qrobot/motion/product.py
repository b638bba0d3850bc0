"""A product of terms, some of them inverted, as it is evaluated at each sample."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from qrobot.model.transform import inverse
from qrobot.motion.limits import Floats
from qrobot.motion.trsf import Kind, Trsf

_STANDS: Final = (Kind.CONST, Kind.HOLD)


@dataclass(frozen=True)
class Factor:
    """One term of a product."""

    trsf: Trsf
    inverted: bool = False

    def turned(self) -> Factor:
        """Its inverse."""
        return Factor(self.trsf, not self.inverted)

    def at(self, tick: int) -> Floats:
        """Its value at sample `tick`. Shape (4, 4)."""
        value = self.trsf.at(tick)
        return inverse(value) if self.inverted else value


def inverted(factors: Sequence[Factor]) -> list[Factor]:
    """The factors of the inverse product."""
    return [factor.turned() for factor in reversed(factors)]


class Product:
    """The terms as a motion takes them along.

    Constant and hold transforms are copied now, and neighbours among them multiplied (B-14, B-16); variable and
    functional ones are asked at each sample.

    Args:
        parts: factors, and fixed transforms of shape (4, 4), from left to right.
    """

    def __init__(self, parts: Iterable[Factor | Floats]) -> None:
        self._parts: list[Factor | Floats] = []
        for part in parts:
            self._append(part)

    @property
    def fixed(self) -> bool:
        """Its value never changes."""
        return not any(isinstance(part, Factor) for part in self._parts)

    def __len__(self) -> int:
        """Number of factors left to multiply at each sample."""
        return len(self._parts)

    def at(self, tick: int) -> Floats:
        """Its value at sample `tick`. Shape (4, 4)."""
        value: Floats | None = None
        for part in self._parts:
            factor = part.at(tick) if isinstance(part, Factor) else part
            value = np.array(factor) if value is None else value @ factor  # never a term's own array
        return np.eye(4) if value is None else value

    def _append(self, part: Factor | Floats) -> None:
        if isinstance(part, Factor) and part.trsf.kind not in _STANDS:
            self._parts.append(part)
            return
        fixed = part.at(0) if isinstance(part, Factor) else part
        if self._parts and not isinstance(self._parts[-1], Factor):
            self._parts[-1] = self._parts[-1] @ fixed
        else:
            self._parts.append(np.array(fixed))
