"""Torque scales of the motors, sought together with what is linear.

u_i = s_i (Y_i beta) + friction_i is linear in beta or in s, not in both: Gauss and Newton's method, of which every step
is a robust linear fit. Weight cannot tell a common factor of all scales from a heavier arm, so one motor's torque is
the unit of the others, unless a known load was carried. The ratio of two scales is told by what both motors feel: of a
PUMA shoulder and elbow the forearm's weight. A motor that feels no weight, the waist of an upright arm, keeps what is
believed of every scale beforehand, and what the servo commands it is right all the same, but for its inertia. So does
one that feels next to none: what is fitted there are errors of the model, and no scale.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from qrobot.arrays import Floats, Ints
from qrobot.ident.fit import KNOWN, Fit, fit_linear
from qrobot.ident.observe import SCALE_DOUBT, Observations
from qrobot.ident.unknowns import Unknowns

LOAD_DOUBT: Final = 1e-3  # of a load that was weighed
TOLD: Final = 0.2  # [A] half width of the 95 % interval of a scale that the observations tell, a third of that before
MOVED: Final = 0.1  # [A] of its half width, from 1: one that has moved less is where it was believed
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
    fit, n_values = _fit_with_inertia(unknowns, observations, load_kg), len(unknowns.start())
    return replace(fit, values=fit.values[:n_values], covariance=fit.covariance[:n_values, :n_values])


def inertia_errors(unknowns: Unknowns, observations: Observations, load_kg: float | None = None) -> Floats:
    """Errors of inertia, in likely ones, as a fit of the observations finds them. Shape (i,)."""
    if not observations.inertia.shape[1]:
        return np.zeros(0)
    return _fit_with_inertia(unknowns, observations, load_kg).values[len(unknowns.start()) :]


def less_inertia(observations: Observations, errors: Floats) -> Observations:
    """The observations without the torque of errors of inertia (i,)."""
    return replace(observations, torque=observations.torque - observations.inertia @ errors)


def _fit_with_inertia(unknowns: Unknowns, observations: Observations, load_kg: float | None) -> Fit:
    """Everything unknown, then the errors of inertia, in likely ones. Raises IdentificationError.

    Scales that the observations do not tell stay as they were believed, and so does the doubt about them.
    """
    fit = _fit_all(unknowns, observations, load_kg)
    places = unknowns.n_weights + unknowns.n_friction + np.arange(len(unknowns.free))
    half = fit.half_width[places]
    untold = (half > TOLD) & (np.abs(fit.values[places] - 1.0) > MOVED * half)
    if not untold.any():
        return fit
    told = replace(unknowns, free=tuple(np.array(unknowns.free)[~untold].tolist()))
    return _believing(_fit_all(told, observations, load_kg), fit, places[untold])


def _believing(told: Fit, free: Fit, places: Ints) -> Fit:
    """The fit `told` with scales of 1 inserted, in the end at `places`, and the doubt that they bring with them.

    How the other values go with these scales says the fit `free`, in which they were sought.
    """
    before = places - np.arange(places.size)  # in what they are inserted into
    covariance = np.insert(np.insert(told.covariance, before, 0.0, axis=0), before, 0.0, axis=1)
    slopes = free.covariance[:, places] @ np.linalg.inv(free.covariance[np.ix_(places, places)])
    covariance += SCALE_DOUBT**2 * slopes @ slopes.T
    return replace(told, values=np.insert(told.values, before, 1.0), covariance=covariance)


def _fit_all(unknowns: Unknowns, observations: Observations, load_kg: float | None) -> Fit:
    """Everything unknown, told or not, then the errors of inertia. Raises IdentificationError."""
    known, target, doubt = _known_rows(unknowns, load_kg)
    inertia = observations.inertia
    n_errors = inertia.shape[1]
    known, target, doubt = (
        np.block([[known, np.zeros((len(known), n_errors))], [np.zeros((n_errors, known.shape[1])), np.eye(n_errors)]]),
        np.concatenate([target, np.zeros(n_errors)]),
        np.concatenate([doubt, np.ones(n_errors)]),
    )
    row_class = np.concatenate([observations.motor, np.full(len(target), KNOWN)])
    doubts, values = np.concatenate([observations.doubt, doubt]), unknowns.start()
    names = [*unknowns.names, *(f"inertia {number}" for number in range(n_errors))]
    for _ in range(_STEPS):
        A = unknowns.jacobian(values, observations)
        b = observations.torque - unknowns.predict(values, observations) + A @ values
        rows = np.vstack([np.column_stack([A, inertia]), known])
        fit = fit_linear(rows, np.concatenate([b, target]), row_class, names, doubts)
        found = fit.values[: len(values)]
        moved, values = found - values, found
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
