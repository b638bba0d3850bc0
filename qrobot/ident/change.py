"""Whether something changed while an arm was recorded: a load put down, or dropped, or a counter that slipped.

What is there from pass k on adds its own columns to the equations of those passes. For each k they are fitted to what
is left, with everything else fitted anew; the k that explains most is the suspect. Its gain is the squares that it
explains over the variance that it leaves: of pure chance about the number of its values, of what the model does not
know of friction and inertia, which is alike in neighbouring passes, tens, and of 0.1 kg that go half way hundreds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from qrobot.arrays import Floats
from qrobot.ident.model import Identified
from qrobot.ident.observe import Observations
from qrobot.ident.whitened import WhitenedFit, unexplained

CLEARLY: Final = 100.0  # squares that a change explains, over the variance that it leaves [A]
SMALLEST_KG: Final = 0.1  # less is not told: friction that drifts looks like some of it
SMALLEST_RAD: Final = 0.01  # rad (m) of a motor in joint units, some hundred counts of a PUMA
LARGEST_KG: Final = 10.0  # four times what a PUMA's hand may hold: more is no load but columns that tell nothing
LARGEST_RAD: Final = 0.5  # a motor's position that is off by more is seen in the rows
_STEP: Final = 1e-4  # rad (m), of the derivative by position


@dataclass(frozen=True)
class LoadChange:
    """Change of the carried load by `kg`, from pass number `passed` on, at `time_s` of the recording."""

    passed: int
    time_s: float
    kg: float


@dataclass(frozen=True)
class CounterSlip:
    """Slip of the counter of `motor` by `counts`, from pass number `passed` on, at `time_s` of the recording."""

    passed: int
    time_s: float
    motor: int
    counts: float


class Suspect(NamedTuple):
    """A change from pass `passed` on: its values, its gain, and the squares that it explains."""

    passed: int
    values: Floats
    gain: float
    explained: float


def load_change(found: Identified) -> LoadChange | None:
    """The change of load that the passes of an arm show, none if they show none. Mass in the unit of `found.beta`."""
    suspect = _suspected_load(found)
    if suspect.gain < CLEARLY:
        return None
    return LoadChange(suspect.passed, _begin(found.observations, suspect.passed), float(suspect.values[0]))


def counter_slip(found: Identified) -> CounterSlip | None:
    """The counter that slipped, as gravity shows it; none if none did, or what was seen is rather a change of load."""
    whitened, seen, robot = _whitened(found), found.observations, found.robot
    slopes = position_slopes(found)
    suspects = [_suspect(whitened, seen, slopes[:, motor, None], SMALLEST_RAD, LARGEST_RAD) for motor in range(robot.n)]
    motor = max(range(robot.n), key=lambda each: suspects[each].gain)
    passed, values, gain, explained = suspects[motor]
    if gain < CLEARLY or explained < _suspected_load(found).explained:
        return None
    counts = -float(values[0] / robot.transmission.rad_per_count[motor])
    return CounterSlip(passed, _begin(seen, passed), motor, counts)


def position_slopes(found: Identified) -> Floats:
    """Derivative of the torque of each observation by the position of each motor. Shape (m, n)."""
    seen, robot = found.observations, found.robot
    to_motor = np.linalg.inv(robot.transmission.coupling.T)
    slopes = np.empty((len(seen), robot.n))
    for motor, direction in enumerate(np.linalg.inv(robot.transmission.coupling).T):
        ahead, behind = (found.regressor(seen.q + sign * _STEP * direction) for sign in (1.0, -1.0))
        change = to_motor @ found.base.columns((ahead - behind) / (2.0 * _STEP)) @ found.beta
        slopes[:, motor] = found.scale[seen.motor] * change[np.arange(len(seen)), seen.motor]
    return slopes


def _suspected_load(found: Identified) -> Suspect:
    """The most suspicious change of load of at least the smallest mass that is told."""
    seen = found.observations
    return _suspect(_whitened(found), seen, found.scale[seen.motor, None] * seen.load, SMALLEST_KG, LARGEST_KG)


def _whitened(found: Identified) -> WhitenedFit:
    seen, unknowns, values = found.observations, found.unknowns, found.fit.values
    count = np.sqrt(found.fit.weight[: len(seen)]) / np.hypot(found.fit.scatter[seen.motor], seen.doubt)
    fitted, _ = np.linalg.qr(unknowns.jacobian(values, seen) * count[:, None])
    left = unexplained(fitted, (seen.torque - unknowns.predict(values, seen)) * count)
    return WhitenedFit(left, fitted, count)


def _suspect(whitened: WhitenedFit, seen: Observations, columns: Floats, smallest: float, largest: float) -> Suspect:
    """The change with columns (m, c) that explains most, of those whose first value is likely."""
    left, fitted, inverse = whitened
    weighted, none = columns * inverse[:, None], Suspect(0, np.zeros(columns.shape[1]), 0.0, 0.0)
    freedom = max(len(left) - fitted.shape[1] - columns.shape[1], 1)
    best, before = none, float(left @ left)
    for k in np.unique(seen.passed)[1:]:
        own = unexplained(fitted, weighted * (seen.passed >= k)[:, None])
        values = np.asarray(np.linalg.lstsq(own, left, rcond=1e-6)[0], np.float64)
        after = float(((left - own @ values) ** 2).sum())
        if before - after > best.explained and smallest <= abs(values[0]) <= largest:
            gain = (before - after) / max(after / freedom, 1e-12)
            best = Suspect(int(k), values, gain, before - after)
    return best


def _begin(seen: Observations, passed: int) -> float:
    return float(seen.time_s[seen.passed >= passed].min())
