"""Compliance that a program asks for: axes of the controlled frame along which the arm gives way, and limits of force.

While the arm complies its equation carries one transform more (Hayward & Paul 1986, equation 15):

    T6 = R P DRIVE(s) COMPLY E

COMPLY holds how far the controlled frame was carried along its compliant axes, so that the goal remains exact along and
about all others.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.motion.world.drive_transform import drive
from qrobot.motion.world.trsf import TransformKind, Trsf

N_AXES: Final = 6
AXES: Final = ("x", "y", "z", "about x", "about y", "about z")


class Drift:
    """Drift of the controlled frame of one arm along its compliant axes.

    Attributes:
        values: m and rad, in the controlled frame. Shape (6,).
    """

    def __init__(self) -> None:
        self.values = np.zeros(N_AXES)

    def keep(self, axes: tuple[int, ...]) -> None:
        """Forget the axes that are not among `axes`."""
        kept = np.zeros(N_AXES)
        kept[list(axes)] = self.values[list(axes)]
        self.values = kept


@dataclass(frozen=True, eq=False)
class Compliance:
    """Give way along some axes of the controlled frame, exerting given forces.

    Attributes:
        wrench: what the arm exerts along its compliant axes, N and N m, nothing along the others. Shape (6,).
        axes: the compliant ones, 0 to 5.
        drift: of the arm; several compliances of one arm share it.
        transform: COMPLY, a term of the equations of motions that comply.

    Raises:
        MotionError: no axis, an axis twice, or a force that is no number.
    """

    wrench: Floats
    axes: tuple[int, ...]
    drift: Drift
    transform: Trsf = field(init=False)

    def __post_init__(self) -> None:
        if not self.axes or len(set(self.axes)) != len(self.axes) or not set(self.axes) <= set(range(N_AXES)):
            raise MotionError(f"compliant axes must be different ones of 0 to {N_AXES - 1}, not {list(self.axes)}")
        if not np.isfinite(self.wrench).all():
            raise MotionError(f"the forces of a compliance must be finite, not {self.wrench.tolist()}")
        object.__setattr__(self, "transform", Trsf("COMPLY", TransformKind.FUNCTION, function=self._carry))

    @property
    def names(self) -> str:
        """The compliant axes in words."""
        return ", ".join(AXES[axis] for axis in self.axes)

    def _carry(self, comply: Trsf) -> None:
        columns = list(self.axes)
        carried = np.zeros(N_AXES)
        carried[columns] = self.drift.values[columns]
        comply.value = drive(carried)


def _unlimited() -> Floats:
    return np.full(N_AXES, np.inf)


@dataclass(frozen=True, eq=False)
class ForceLimits:
    """Limits that end a motion before its goal; infinite where there is none.

    Attributes:
        force: along and about the axes of the controlled frame, N and N m. Shape (6,).
        motion: how far the controlled frame may be from where the motion wants it, m and rad. Shape (6,).
    """

    force: Floats = field(default_factory=_unlimited)
    motion: Floats = field(default_factory=_unlimited)

    def __post_init__(self) -> None:
        both = np.concatenate((self.force, self.motion))
        if both.shape != (2 * N_AXES,) or not (both > 0.0).all():
            raise MotionError(f"limits of force and motion must be positive, not {both.tolist()}")
