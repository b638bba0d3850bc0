"""Matching of a run of index pulses to rows of the calibration table.

Index pulses met one after the other are consecutive rows. The best first row s has the least sum of deviations

    misfit(s) = sum over k of |pot[k] - table[s + k]|

(least absolute deviations, as in the vendor's driver v4.3, so that one bad reading does not decide). It is taken only
when every check below holds; a wrong row is a whole motor turn, so refusing is always better than guessing.
"""

from __future__ import annotations

from typing import Any, Final

from qrobot.faultcodes import FaultCode
from qrobot.realtime.jit import lean_kernel

NONE: Final = int(FaultCode.NONE)
CAL_MISMATCH: Final = int(FaultCode.CAL_MISMATCH)
CAL_VOTE: Final = int(FaultCode.CAL_VOTE)

MOST_MISFIT: Final = 0.4  # of a row's pot travel, mean over the index pulses; backlash alone makes 0.3
LEAST_MARGIN: Final = 0.2  # by which the second best place has to be worse, likewise


@lean_kernel
def misfit(table: Any, joint: int, pots: Any, n: int, first: int) -> float:
    """Mean distance of `pots[:n]` from rows `first`, `first + 1`, ... of the table, ADC units."""
    total = 0.0
    for k in range(n):
        total += abs(pots[k] - table.pot[joint, first + k])
    return total / n


@lean_kernel
def nearest_row(table: Any, joint: int, pot: float) -> int:
    """The row whose reading is nearest."""
    best = 0
    for row in range(1, table.rows[joint]):
        if abs(pot - table.pot[joint, row]) < abs(pot - table.pot[joint, best]):
            best = row
    return best


@lean_kernel
def pot_step(table: Any, joint: int) -> float:
    """Pot travel from one row to the next, ADC units, unsigned: the mean without the first row."""
    rows = table.rows[joint]
    return float(abs(table.pot[joint, rows - 1] - table.pot[joint, 1]) / (rows - 2))


@lean_kernel
def in_table(table: Any, joint: int, pot: float, beyond: int) -> bool:
    """True for a reading between those of the table's ends, `beyond` rows more on each side. NaN is not."""
    step = beyond * pot_step(table, joint)
    first, last = table.pot[joint, 0], table.pot[joint, table.rows[joint] - 1]
    return bool(min(first, last) - step <= pot <= max(first, last) + step)


@lean_kernel
def find_rows(table: Any, joint: int, pots: Any, n: int) -> tuple[int, int, float, float, int]:
    """(code, first row, misfit, margin, votes) of the readings `pots[:n]` at consecutive index pulses.

    Codes: CAL_MISMATCH when a reading is none of the table's; CAL_VOTE when fewer than most of the readings agree, the
    best place fits badly, or the second best nearly as well. `margin` is by how much the second best is worse.
    """
    for k in range(n):
        if not in_table(table, joint, pots[k], 1):
            return CAL_MISMATCH, 0, 0.0, 0.0, 0
    best, second, row = 1e9, 1e9, 0
    for first in range(table.rows[joint] - n + 1):
        distance = misfit(table, joint, pots, n, first)
        if distance < best:
            best, second, row = distance, best, first
        elif distance < second:
            second = distance
    votes = 0
    for k in range(n):
        if nearest_row(table, joint, pots[k]) == row + k:
            votes += 1
    step = pot_step(table, joint)
    agreed = 2 * votes > n and best <= MOST_MISFIT * step and second - best >= LEAST_MARGIN * step
    return NONE if agreed else CAL_VOTE, row, best, second - best, votes
