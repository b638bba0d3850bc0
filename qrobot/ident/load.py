"""Whether what the hand carries changed while an arm was recorded: a load put down, or dropped, half way.

A load that is there from pass k on adds its own columns to the equations of those passes. For each k they are fitted to
what is left, with everything else fitted anew; the k that explains most of it is the suspect.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from qrobot.ident.model import Identified

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

EXPLAINED: Final = 0.5  # share of the squares a motor has left that a change takes away; chance takes a tenth
FEWEST: Final = 10  # observations of such a motor
SMALLEST_KG: Final = 0.1  # less is not told: friction that drifts looks like some of it


@dataclass(frozen=True)
class LoadChange:
    """From pass number `passed` on, at `time_s` of the recording, the hand carried `kg` more (negative: less)."""

    passed: int
    time_s: float
    kg: float


def load_change(found: Identified) -> LoadChange | None:
    """The change of load that the passes of an arm show, none if they show none. Mass in the unit of `found.beta`."""
    seen, unknowns, values = found.observations, found.unknowns, found.fit.values
    count = 1.0 / np.hypot(found.fit.scatter[seen.motor], seen.doubt)
    fitted, _ = np.linalg.qr(unknowns.jacobian(values, seen) * count[:, None])
    left = _beside(fitted, (seen.torque - unknowns.predict(values, seen)) * count)
    load = (found.scale[seen.motor] * count)[:, None] * seen.load
    best, most = None, 0.0
    for k in np.unique(seen.passed)[1:]:
        after = seen.passed >= k
        kg, explained = _explained(_beside(fitted, load * after[:, None]), left)
        gain = float(left @ left - (left - explained) @ (left - explained))
        if gain > most and abs(kg) > SMALLEST_KG and _clearly(left, left - explained, seen.motor):
            best, most = LoadChange(int(k), float(seen.time_s[after].min()), kg), gain
    return best


def _beside(fitted: Floats, columns: Floats) -> Floats:
    """What of columns (m, ...) the orthonormal columns `fitted` (m, p) cannot explain."""
    return np.asarray(columns - fitted @ (fitted.T @ columns))


def _explained(load: Floats, left: Floats) -> tuple[float, Floats]:
    """Mass of the load that explains most of what is left, and what it explains. Shape (m,)."""
    amounts = np.linalg.lstsq(load, left, rcond=1e-6)[0]
    return float(amounts[0]), load @ amounts


def _clearly(before: Floats, after: Floats, motor: Ints) -> bool:
    """Some motor has much less left."""
    many = np.bincount(motor) >= FEWEST
    squares, rest = np.bincount(motor, before**2)[many], np.bincount(motor, after**2)[many]
    return bool((rest < (1.0 - EXPLAINED) * squares).any())
