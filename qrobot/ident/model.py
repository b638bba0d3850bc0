"""Gravity, friction and torque scales of an arm, estimated from observations and judged on some that were held back."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from qrobot.arrays import Floats, Ints
from qrobot.config import Robot
from qrobot.config.identified import IdentifiedValue
from qrobot.errors import IdentificationError
from qrobot.ident.base import BaseParameters, base_parameters
from qrobot.ident.fit import OUTLIER, Fit
from qrobot.ident.observe import Observations
from qrobot.ident.regressor import Regressor
from qrobot.ident.scale import fit_scaled, heaviest_motor, inertia_errors, less_inertia
from qrobot.ident.structure import terms_of, terms_seen
from qrobot.ident.swings import swings_of
from qrobot.ident.terms import KINDS, FrictionTermKind, Terms
from qrobot.ident.unknowns import OF_LOAD, Description, Unknowns

CLEARLY: Final = 2.0  # half widths of its interval from nothing
DRIFTS: Final = 0.03  # of friction over a recording: less is not worth a word
VARIES: Final = 0.01  # rms, of Coulomb friction: terms that are less are not worth a word
_ADVICE: Final[dict[FrictionTermKind, str]] = {
    "position": "It is fitted beside the rest, whose intervals are wider for it; no law compensates it. "
    "More --poses, and `--friction position`, tell it better",
    "speed": "Viscous and Coulomb friction are told apart only as well as their intervals say: "
    "`record --slow`, then `identify friction`, and `--friction speed`, tell more",
    "load": "It is fitted beside the rest; no law compensates it. `--friction load` seeks it on every motor",
}
HELD_BACK: Final = 5  # every fifth swing is not fitted at first, but predicted


@dataclass(frozen=True, eq=False)
class Identified:
    """Model of an arm identified from steady passes.

    Attributes:
        unknowns: what was sought, in the order of the fit.
        fit: of the unknowns.
        observations: what was fitted.
        held_back_rms: error with which a servo that had the numbers of the other passes would predict those held back,
            unloaded ones, motor side, N m (N). Shape (n,).
        before_rms: error of the robot file's prediction of the same passes. Shape (n,).
        held_back_doubt: deviation of that prediction for what the other passes leave in doubt. Shape (n,).
    """

    unknowns: Unknowns
    fit: Fit
    observations: Observations
    held_back_rms: Floats
    before_rms: Floats
    held_back_doubt: Floats

    @property
    def robot(self) -> Robot:
        """The robot file before."""
        return self.unknowns.robot

    @property
    def base(self) -> BaseParameters:
        """Base parameters of gravity."""
        return self.unknowns.base

    @property
    def regressor(self) -> Regressor:
        """Regressor of the robot's gravity."""
        return self.unknowns.regressor

    @property
    def beta(self) -> Floats:
        """Base parameters of gravity, kg m (kg for masses). Shape (b,)."""
        return self.fit.values[: len(self.base.leading)]

    @property
    def friction(self) -> Floats:
        """Viscous, Coulomb of positive and of negative motion, by motor, as commanded torque. Shape (n, 3)."""
        return self.unknowns.parts(self.fit.values).friction

    @property
    def compensated(self) -> Floats:
        """Values as a servo has them, whose friction is viscous and Coulomb's alone. Shape (p,)."""
        unloaded = self.observations.only(~self.observations.loaded)
        return np.asarray(self.unknowns.compensated(self.fit.values, unloaded) @ self.fit.values)

    @property
    def compensated_friction(self) -> Floats:
        """Friction as `friction`, with what of the terms it can stand for. Shape (n, 3)."""
        return self.unknowns.parts(self.compensated).friction

    @property
    def sticking(self) -> tuple[str, ...]:
        """Motors whose friction clearly falls with speed, which no law compensates."""
        found, half_width = map(self.unknowns.parts, (self.fit.values, self.fit.half_width))
        clearly = (found.remainder > CLEARLY * half_width.remainder).any(axis=1)
        return tuple(np.array(self.robot.joint_names)[clearly].tolist())

    @property
    def drifting(self) -> dict[str, float]:
        """Motors whose friction clearly changed during the recording, and the share by which it rose."""
        drift, half_width = (self.unknowns.parts(each).drift for each in (self.fit.values, self.fit.half_width))
        clearly = np.abs(drift) > np.maximum(CLEARLY * half_width, DRIFTS)
        return {self.robot.joint_names[motor]: float(drift[motor]) for motor in np.flatnonzero(clearly)}

    @property
    def varying(self) -> dict[str, dict[FrictionTermKind, float]]:
        """Motors whose friction varies otherwise than its model says: kind, and rms as a share of Coulomb friction."""
        terms, seen, n = self.unknowns.terms, self.observations, self.robot.n
        if terms is None:
            return {}
        of_terms, values = self.unknowns.term_columns(seen), self.unknowns.parts(self.fit.values).terms
        coulomb = np.abs(self.friction[:, 1:]).mean(axis=1)
        found: dict[str, dict[FrictionTermKind, float]] = {}
        for number, (motor, kind, _) in enumerate(terms.sought):
            own = terms.owner == number
            size = float(
                rms_by_motor(of_terms[:, own] @ values[own], seen.motor, n)[motor] / max(coulomb[motor], 1e-12)
            )
            if size > VARIES:
                found.setdefault(self.robot.joint_names[motor], {})[kind] = size
        return found

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings for whoever uses the result."""
        said = []
        if self.sticking:
            tells = "`record --slow` and `identify friction` tell more"
            said.append(
                f"friction of {', '.join(self.sticking)} is more near standstill than any law compensates: {tells}"
            )
        for motor, share in self.drifting.items():
            changed = f"friction of {motor} {'rose' if share > 0.0 else 'fell'} by {100 * abs(share):.0f} %"
            said.append(f"{changed} during the recording: let the arm warm up before it is recorded")
        for kind in KINDS:
            sizes = {motor: kinds[kind] for motor, kinds in self.varying.items() if kind in kinds}
            if sizes:
                named = ", ".join(f"{motor} by {100.0 * size:.0f} %" for motor, size in sizes.items())
                said.append(f"friction varies with {kind} (rms, of Coulomb friction): {named}. {_ADVICE[kind]}")
        return tuple(said)

    @property
    def scale(self) -> Floats:
        """Torque scales of the motors; 1 where none was sought. Shape (n,)."""
        return self.unknowns.scale(self.fit.values)

    def gravity(self, q: Floats) -> Floats:
        """Torques to command that hold the arm, without a load, at positions of shape (m, n). N m (N), shape (m, n)."""
        coupling = self.robot.transmission.coupling
        given = self.base.columns(self.regressor(q)) @ self.beta
        return np.asarray(given @ np.linalg.inv(coupling) * self.scale @ coupling)

    @property
    def values(self) -> list[IdentifiedValue]:
        """Everything, with its uncertainty and what the robot file says."""
        numbers = zip(self.fit.values.tolist(), self.fit.half_width.tolist(), strict=True)
        return [
            identified_value(d, value, half_width)
            for d, (value, half_width) in zip(self.unknowns.descriptions(), numbers, strict=True)
        ]


def identified_value(described: Description, value: float, half_width: float) -> IdentifiedValue:
    """A value that was found, with the half width of its 95 % interval."""
    d = described
    return IdentifiedValue(
        name=d.name, meaning=d.meaning, unit=d.unit, value=value, half_width=half_width, before=d.before
    )


def identify(
    robot: Robot,
    base: BaseParameters,
    regressor: Regressor,
    observations: Observations,
    known_torque: bool = False,
    load_kg: float | None = None,
    kinds: tuple[FrictionTermKind, ...] | None = None,
) -> Identified:
    """Estimate gravity, friction, torque scales, and the load of passes that carried one.

    Args:
        robot: the robot file.
        base: parameters of `regressor`.
        regressor: of its gravity.
        observations: passes.
        known_torque: the robot file's `dac_per_Nm` was measured, no torque scales are sought.
        load_kg: mass of the load that was carried, if it was weighed: then scales are of true torque.
        kinds: of terms of friction that are sought of every motor; default those that residuals show.

    Raises:
        IdentificationError: the observations do not determine them; says what is missing.
    """
    if not len(observations):
        raise IdentificationError("nothing recorded moves steadily: record the passes of `qrobot identify plan`")
    load, seconds = _load_told(observations, load_kg), max(float(observations.time_s.max()), 1.0)
    unknowns = Unknowns(robot, regressor, base, load, seconds=seconds)
    if not known_torque:
        unknowns = replace(unknowns, free=_free(unknowns, observations, load_kg))
    held = swings_of(robot, observations) % HELD_BACK == HELD_BACK - 1
    whole, trial = (_fitted(unknowns, each, load_kg, kinds) for each in (observations, observations.only(~held)))
    kept = less_inertia(observations.only(held & ~observations.loaded), trial.errors)  # the robot file knows no load
    of_servo = trial.unknowns.compensated(trial.fit.values, trial.observations.only(~trial.observations.loaded))
    written = of_servo @ trial.fit.values
    doubt = _doubt(trial.unknowns.jacobian(written, kept) @ of_servo, trial.fit)
    return Identified(
        whole.unknowns,
        whole.fit if whole.unknowns.terms is None else _widened(whole, trial, kept),
        whole.observations,
        rms_by_motor(kept.torque - trial.unknowns.predict(written, kept), kept.motor, robot.n),
        rms_by_motor(kept.torque - unknowns.predict(unknowns.before(), kept), kept.motor, robot.n),
        rms_by_motor(doubt, kept.motor, robot.n),
    )


class _FitOfPasses(NamedTuple):
    """Unknowns as some passes tell them.

    Attributes:
        unknowns: what was sought, with the terms of friction that they show.
        observations: passes without the torque of errors of inertia.
        errors: those errors. Shape (i,).
        plain: fit without terms.
        fit: with them.
    """

    unknowns: Unknowns
    observations: Observations
    errors: Floats
    plain: Fit
    fit: Fit


def _fitted(
    unknowns: Unknowns, observations: Observations, load_kg: float | None, kinds: tuple[FrictionTermKind, ...] | None
) -> _FitOfPasses:
    """Everything unknown: errors of inertia, then friction as the servo has it, then its terms beside the rest."""
    errors = inertia_errors(unknowns, observations, load_kg)
    observations = less_inertia(observations, errors)
    plain = fit_scaled(unknowns, observations, load_kg)
    terms = _terms(unknowns, plain, observations, kinds)
    if terms is None:
        return _FitOfPasses(unknowns, observations, errors, plain, plain)
    unknowns = replace(unknowns, terms=terms)
    return _FitOfPasses(unknowns, observations, errors, plain, fit_scaled(unknowns, observations, load_kg))


def _widened(whole: _FitOfPasses, trial: _FitOfPasses, kept: Observations) -> Fit:
    """The fit with the intervals that passes held back call for: terms may follow what is chance.

    Weights are taken as no better known than without terms: those are of friction, and tell nothing of weight.

    Args:
        whole: what all passes tell.
        trial: what those tell that were not held back.
        kept: passes held back.
    """
    doubt = _doubt(trial.unknowns.jacobian(trial.fit.values, kept), trial.fit)
    expected = np.sqrt(doubt**2 + kept.doubt**2 + trial.fit.scatter[kept.motor] ** 2)
    off = np.abs(kept.torque - trial.unknowns.predict(trial.fit.values, kept)) / expected
    surprise = float(np.sqrt(np.mean(np.minimum(off, OUTLIER) ** 2))) if len(kept) else 1.0
    fit, weights = whole.fit, slice(whole.unknowns.n_weights)
    wider = np.full(len(fit.values), max(1.0, surprise))
    wider[weights] = np.maximum(wider[weights], whole.plain.half_width[weights] / fit.half_width[weights])
    return replace(fit, covariance=np.outer(wider, wider) * fit.covariance)


def _doubt(slopes: Floats, fit: Fit) -> Floats:
    """Deviation of what is predicted with slopes (m, p) by the values of a fit. Shape (m,)."""
    return np.asarray(np.sqrt(np.maximum((slopes @ fit.covariance * slopes).sum(axis=1), 0.0)))


def _terms(
    unknowns: Unknowns, plain: Fit, observations: Observations, kinds: tuple[FrictionTermKind, ...] | None
) -> Terms | None:
    """The terms of friction that are asked for, or else those that a fit without them shows."""
    if kinds is None:
        return terms_seen(unknowns, plain, observations)
    turning = np.unique(observations.motor).tolist()
    sought = [(motor, kind) for motor in turning for kind in kinds]
    return terms_of(unknowns, plain, observations, sought) if sought else None


def _free(unknowns: Unknowns, observations: Observations, load_kg: float | None) -> tuple[int, ...]:
    """Motors whose scales are sought: all when a load was weighed, or else all but the one that is the unit."""
    motors = range(unknowns.robot.n)
    if load_kg is not None:
        return tuple(motors)
    unit = heaviest_motor(unknowns, observations)
    return tuple(motor for motor in motors if motor != unit)


def _load_told(observations: Observations, load_kg: float | None) -> BaseParameters | None:
    """Load parameters that the passes which carried it determine; none when none did.

    Raises:
        IdentificationError: a load was weighed, but its mass cannot be told from its first moments.
    """
    carried = observations.load[observations.loaded]
    told = base_parameters(carried, OF_LOAD) if len(carried) else None
    if load_kg is not None and (told is None or told.combination(0) != OF_LOAD[0]):
        raise IdentificationError(f"a load of {load_kg:g} kg is told of, but no pass that carried it shows its mass")
    return told


def rms_by_motor(error: Floats, motor: Ints, n: int) -> Floats:
    """Root mean square, NaN where there is nothing to judge by. Shape (n,)."""
    squares, counts = np.bincount(motor, error**2, n), np.bincount(motor, minlength=n)
    return np.sqrt(np.where(counts > 0, squares, np.nan) / np.maximum(counts, 1))
