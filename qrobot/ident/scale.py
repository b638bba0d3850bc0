"""Torque scales of the motors, sought together with what is linear.

u_i = s_i (Y_i beta) + friction_i is linear in beta or in s, not in both: Gauss and Newton's method, of which every step
is a robust linear fit. Weight cannot tell a common factor of all scales from a heavier arm, so one motor's torque is
the unit of the others, unless a known load was carried. The ratio of two scales is told by what both motors feel: of a
PUMA shoulder and elbow the forearm's weight. A motor that feels no weight, the waist of an upright arm, keeps what is
believed of every scale beforehand, and what the servo commands it is right all the same, but for its inertia.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.ident.fit import KNOWN, Fit, fit_linear
from qrobot.ident.observe import Observations
from qrobot.ident.unknowns import Unknowns

LOAD_DOUBT: Final = 1e-3  # of a load that was weighed
_STEPS: Final = 30
_SETTLED: Final = 1e-6


def heaviest_motor(unknowns: Unknowns, observations: Observations) -> int:
    """The motor that bears the most weight, by the robot file: its torque is the unit."""
    known = unknowns.before()[: unknowns.n_weights]
    borne = (unknowns.weights(observations) @ known) ** 2
    return int(np.bincount(observations.motor, borne, unknowns.robot.n).argmax())


def fit_scaled(unknowns: Unknowns, observations: Observations, load_kg: float | None = None) -> Fit:
    """Everything unknown, from observations.

    Args:
        unknowns: what is sought.
        observations: passes of the arm.
        load_kg: mass of the load that was carried, where it was weighed.

    Raises:
        IdentificationError: the observations do not determine it; says what is missing.
    """
    known, target, doubt = _known_rows(unknowns, load_kg)
    row_class = np.concatenate([observations.motor, np.full(len(target), KNOWN)])
    doubts, values = np.concatenate([observations.doubt, doubt]), unknowns.start()
    for _ in range(_STEPS):
        A = unknowns.jacobian(values, observations)
        b = observations.torque - unknowns.predict(values, observations) + A @ values
        fit = fit_linear(np.vstack([A, known]), np.concatenate([b, target]), row_class, unknowns.names, doubts)
        moved, values = fit.values - values, fit.values
        if np.linalg.norm(moved) <= _SETTLED * np.linalg.norm(values):
            break
    return fit


def _known_rows(unknowns: Unknowns, load_kg: float | None) -> tuple[Floats, Floats, Floats]:
    """Rows, values and deviations of what is known beforehand: of the unknowns' own, and a load that was weighed."""
    value, doubt = unknowns.start(), unknowns.doubt()
    if load_kg is not None:
        mass = len(unknowns.base.leading)
        value[mass], doubt[mass] = load_kg, LOAD_DOUBT * load_kg
    known = np.isfinite(doubt)
    return np.eye(len(value))[known], value[known], doubt[known]
