"""The servo's own look at fences: where the arm would come to rest if it were stopped now, as one kernel.

It is reached by its address, so that the cycle is the same code for arms with fences and without, whatever their
number; where there are none, nothing of it is compiled.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numba import types

from qrobot.arrays import Floats
from qrobot.fences.clearance import clearances
from qrobot.fences.table import N_ROWS
from qrobot.realtime.jit import lean_kernel
from qrobot.realtime.pointer import KernelPointer, function_at

STOP_PEAK: Final = 1.875  # greatest slope of the profile of a controlled stop, see `servo.kernels.interpolator`
REACTION_S: Final = 0.008  # [A] of the velocity filter, the servo and the motors before the arm brakes
STOP_PLACES: Final = 3  # [A] of its way at which a stop is looked at, besides where it begins
DEEPER_M: Final = 1e-4  # [A] so much deeper than it is already an arm may not come in one look,
CREEP_M: Final = 2e-3  # [A] nor so much deeper than where it was least deep, however slowly
OUTSIDE: Final = -np.inf
N_VERDICT: Final = 3  # 1 to stop, the distance that is left, the number of the fence

VECTOR: Final = types.Array(types.float64, 1, "C")
SIGNATURE: Final = types.void(*[VECTOR] * 9)
gate_at: Final[Any] = function_at(SIGNATURE)


def way_of_stop(v: Floats, a_stop: Floats, late_s: float) -> Floats:
    """Way of a controlled stop of T seconds, v T/2, that begins in `late_s`. Velocities, ways: shape (..., n)."""
    seconds = 0.5 * STOP_PEAK * (np.abs(v) / a_stop).max(axis=-1, keepdims=True) + late_s
    return np.asarray(v * seconds)


@lean_kernel
def gate(
    q: Floats, v: Floats, a_stop: Floats, overshoot_s: Floats, words: Floats, work: Floats, rows: Floats,
    place: Floats, verdict: Floats,
) -> None:  # fmt: skip
    """Judge whether an arm that is stopped now comes to rest before every fence.

    A controlled stop of T seconds covers v T/2, and the arm goes on for a little longer than its reference. One that is
    inside a fence already may leave it, and not go deeper.

    Args:
        q, v: measured position and velocity. Shapes (n,).
        a_stop, overshoot_s: deceleration of a stop, and how far the arm goes on. Shapes (n,).
        words, work: see `fences.clearance.clearances`. place: shape (n,), filled.
        rows: filled; the last ones keep from look to look how little deep an arm inside has been. Shape (4 N_ROWS,).
        verdict: shape (N_VERDICT,), filled.
    """
    now, there, nearest = rows[:N_ROWS], rows[N_ROWS : 2 * N_ROWS], rows[2 * N_ROWS : 3 * N_ROWS]
    least_deep = rows[3 * N_ROWS :]
    n_rows = clearances(q, words, work, now, nearest)
    for k in range(n_rows):
        least_deep[k] = OUTSIDE if now[k] >= 0.0 else max(least_deep[k], now[k])
    seconds, further = 0.0, 0.0
    for j in range(q.size):
        seconds = max(seconds, STOP_PEAK * abs(v[j]) / a_stop[j])
        further = max(further, overshoot_s[j])
    seconds = 0.5 * seconds + further + REACTION_S
    verdict[0], verdict[1], verdict[2] = 0.0, 0.0, -1.0
    for step in range(1, STOP_PLACES + 1):
        for j in range(q.size):
            place[j] = q[j] + v[j] * (seconds * step / STOP_PLACES)
        clearances(place, words, work, there, nearest)
        for k in range(n_rows):
            deeper = now[k] >= 0.0 or now[k] - there[k] > DEEPER_M or least_deep[k] - there[k] > CREEP_M
            if not there[k] >= 0.0 and deeper and not there[k] >= verdict[1]:
                verdict[0], verdict[1], verdict[2] = 1.0, there[k], float(k)


GATE: Final = KernelPointer(gate, SIGNATURE)
