"""A product of terms, some of them inverted, as it is evaluated at each sample."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from qrobot.arrays import Bools, Floats
from qrobot.model.row_ops import store_row, times, times_inverse, unit_row
from qrobot.model.transform import inverse
from qrobot.motion.world.trsf import TransformKind, Trsf
from qrobot.realtime.jit import lean_kernel

_STANDS: Final = (TransformKind.CONST, TransformKind.HOLD)


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


@lean_kernel
def multiply_chain(parts: Floats, inverse_wanted: Bools, out: Floats) -> None:
    """`out` is the product of rigid transforms, of the inverse of some. Shapes (k, 4, 4), (k,), (4, 4)."""
    for i in range(3):
        row = unit_row(i)
        for k in range(parts.shape[0]):
            row = times_inverse(row, parts[k]) if inverse_wanted[k] else times(row, parts[k])
        store_row(row, i, out)


class Product:
    """The terms as a motion takes them along.

    Constant and hold transforms are copied now, and neighbours among them multiplied (B-14, B-16); variable and
    functional ones are asked at each sample.

    Args:
        parts: factors, and fixed transforms of shape (4, 4), from left to right.

    Raises:
        MotionError: the value of a transform is not rigid now; that of a functional one is looked at when it is asked.
    """

    def __init__(self, parts: Iterable[Factor | Floats]) -> None:
        kept = list[Factor | Floats]()
        for part in parts:
            _append(kept, part)
        self._moving = [(k, part.trsf) for k, part in enumerate(kept) if isinstance(part, Factor)]
        self._inverted = np.array([isinstance(part, Factor) and part.inverted for part in kept], dtype=np.bool_)
        self._values = np.empty((len(kept), 4, 4))
        for k, part in enumerate(kept):
            self._values[k] = np.eye(4) if isinstance(part, Factor) else part

    @property
    def fixed(self) -> bool:
        """Its value never changes."""
        return not self._moving

    @property
    def moving(self) -> list[Trsf]:
        """The variable and functional transforms, which are asked at each sample."""
        return [trsf for _, trsf in self._moving]

    def __len__(self) -> int:
        """Number of factors left to multiply at each sample."""
        return len(self._values)

    def at(self, tick: int) -> Floats:
        """Its value at sample `tick`. Shape (4, 4)."""
        values, product = self._values.copy(), np.empty((4, 4))  # copied: a program's thread may ask as well
        for k, trsf in self._moving:
            values[k] = trsf.at(tick)
        multiply_chain(values, self._inverted, product)
        return product


def _append(parts: list[Factor | Floats], part: Factor | Floats) -> None:
    """Append a factor; what stands still as its value, multiplied with what stands still before it."""
    if isinstance(part, Factor) and part.trsf.kind is not TransformKind.FUNCTION:
        part.trsf.check()
    if isinstance(part, Factor) and part.trsf.kind not in _STANDS:
        parts.append(part)
        return
    fixed = part.at(0) if isinstance(part, Factor) else part
    if parts and not isinstance(parts[-1], Factor):
        parts[-1] = parts[-1] @ fixed
    else:
        parts.append(np.array(fixed))
