"""Inertia of an arm beside its gravity and friction: all base parameters, fitted to motion that accelerates.

Motor i has to be commanded u_i = s_i (Y_i(q, v, a) beta + rotors_i) + friction_i. Gravity, friction and the torque
scales s come from steady passes, which tell them best; the first two enter the fit as what is known beforehand, with
their covariance, and the scales and what sticks are taken as they are. Rotor inertia is the robot file's. What the
servo is given are bodies with these parameters (`bodies`), and it is their prediction of motions held back that the
result is judged by.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.config.identified import IdentifiedValue
from qrobot.config.robot import Links
from qrobot.errors import IdentificationError
from qrobot.ident.base import BaseParameters
from qrobot.ident.excitation import FEWEST
from qrobot.ident.fit import KNOWN, Fit, fit_linear
from qrobot.ident.friction import FRICTION_NAMES
from qrobot.ident.model import Identified, identified_value, rms_by_motor
from qrobot.ident.motion import MotionRows
from qrobot.ident.physical_gravity import with_gravity
from qrobot.ident.physical_inertia import nearest_bodies
from qrobot.ident.regressor import OF_GRAVITY, PER_LINK, Regressor, known_parameters
from qrobot.ident.unknowns import Description, of_base, of_friction

OTHER_ARM: Final = 2.0  # times the error with gravity of its own: the same arm has 1.0 to 1.3, 0.3 kg more give 17 [A]
HELD_BACK: Final = 3  # every third motion is not fitted at first, but predicted


@dataclass(frozen=True, eq=False)
class InertialModel:
    """Inertia of an arm identified from accelerated motion.

    Attributes:
        steady: what steady passes told before.
        base: what of inertia and gravity can be told.
        regressor: of both.
        fit: of the base parameters, then of friction.
        links: bodies with these parameters.
        held_back_rms: error of the bodies' prediction of motions held back, motor side, N m (N). Shape (n,).
        before_rms: the same with gravity as found and the inertia of the robot file. Shape (n,).
    """

    steady: Identified
    base: BaseParameters
    regressor: Regressor
    fit: Fit
    links: Links
    held_back_rms: Floats
    before_rms: Floats

    @property
    def beta(self) -> Floats:
        """Base parameters, kg, kg m and kg m2. Shape (b,)."""
        return self.fit.values[: len(self.base.leading)]

    @property
    def friction(self) -> Floats:
        """Viscous, Coulomb of positive and of negative motion, by motor, as commanded torque. Shape (n, 3)."""
        return self.fit.values[len(self.base.leading) :].reshape(-1, len(FRICTION_NAMES))

    @property
    def values(self) -> list[IdentifiedValue]:
        """Everything, with its uncertainty and what the robot file says; what only steady passes tell comes last."""
        described = list(_descriptions(self.steady.robot, self.regressor, self.base))
        numbers = zip(self.fit.values.tolist(), self.fit.half_width.tolist(), strict=True)
        found = [
            identified_value(d, value, half_width) for d, (value, half_width) in zip(described, numbers, strict=True)
        ]
        own = {value.name for value in found} | set(self.steady.base.leaders)
        return found + [value for value in self.steady.values if value.name not in own]


def identify_inertia(steady: Identified, regressor: Regressor, base: BaseParameters, rows: MotionRows) -> InertialModel:
    """Estimate all base parameters of an arm.

    Args:
        steady: what steady passes of the same arm tell.
        regressor: of its inertia and gravity.
        base: parameters of the regressor.
        rows: of at least three motions.

    Raises:
        IdentificationError: there are fewer motions, they do not tell everything, they are another arm's or were made
            with another load, or no bodies have what they tell.
    """
    motions = np.unique(rows.motion).size
    if motions < FEWEST:
        raise IdentificationError(f"{motions} motions recorded, {FEWEST} are needed: record the whole plan")
    robot, held = steady.robot, rows.motion % HELD_BACK == HELD_BACK - 1
    if still := sorted(set(range(robot.n)) - set(rows.motor[~held].tolist())):
        names = ", ".join(robot.joints.names[j] for j in still)
        raise IdentificationError(f"no motion turns {names} fast enough: record the whole plan")
    _need_same_arm(steady, regressor, base, rows)
    before = with_gravity(robot, steady.base, steady.beta)
    trial, kept = _solved(steady, regressor, base, rows.only(~held)), rows.only(held)
    bodies, b = _bodies(robot, base, trial), len(base.leading)
    missed = _error(steady, kept, trial.values[:b], trial.values[b:])
    fit = _widened(_solved(steady, regressor, base, rows), missed / trial.scatter)
    return InertialModel(
        steady,
        base,
        regressor,
        fit,
        _bodies(robot, base, fit),
        _error(steady, kept, _beta(robot, base, regressor, bodies), trial.values[b:]),
        _error(steady, kept, _beta(robot, base, regressor, before.links), steady.compensated_friction.ravel()),
    )


def _need_same_arm(steady: Identified, regressor: Regressor, base: BaseParameters, rows: MotionRows) -> None:
    """Refuse motion whose torques have another gravity than steady passes: of another arm, or with another load.

    Friction is left free, for a drive that has become warm is the same drive.

    Raises:
        IdentificationError: names the motors, what they err by, and what load would explain it.
    """
    gravity = _known_rows(steady, base, gravity_only=True)
    nothing = np.zeros((0, gravity[0].shape[1])), np.zeros(0)
    free, bound = (_solved(steady, regressor, base, rows, known) for known in (nothing, gravity))
    n, count = steady.robot.n, len(rows)
    alone, with_gravity_ = (rms_by_motor(fit.residual[:count], rows.motor, n) for fit in (free, bound))
    step = 1.0 / np.abs(steady.robot.transmission.dac_per_Nm)
    if (others := with_gravity_ > np.maximum(OTHER_ARM * alone, step)).any():
        worst = int(np.argmax(with_gravity_ / alone))
        names = ", ".join(np.array(steady.robot.joint_names)[others])
        raise IdentificationError(
            f"fast motion has another gravity than the steady passes on {names}: torque of "
            f"{steady.robot.joint_names[worst]} is {with_gravity_[worst]:.2g} N m (N) off with theirs and "
            f"{alone[worst]:.2g} with its own. Is it a log of another arm, or was another load in the hand? "
            "Record both with the same"
        )


def _solved(
    steady: Identified,
    regressor: Regressor,
    base: BaseParameters,
    rows: MotionRows,
    beforehand: tuple[Floats, Floats] | None = None,
) -> Fit:
    """Everything, with rows and values of what is known `beforehand`: default all that steady passes tell."""
    scale = steady.scale[rows.motor]
    A = np.column_stack([scale[:, None] * rows.columns, steady.unknowns.friction_jacobian(rows.motor, rows.rate)])
    known, target = beforehand or _known_rows(steady, base)
    row_class = np.concatenate([rows.motor, np.full(len(target), KNOWN)])
    doubt = np.concatenate([rows.doubt, np.ones(len(target))])
    names = [description.name for description in _descriptions(steady.robot, regressor, base)]
    apart = scale * rows.rotors + _stribeck_torque(steady, rows)
    b = np.concatenate([rows.torque - apart, target])
    return fit_linear(np.vstack([A, known]), b, row_class, names, doubt)


def _widened(fit: Fit, surprise: Floats) -> Fit:
    """The fit with the intervals that motions held back call for: windows of one motion share their errors.

    `surprise` is the error of what was predicted over the scatter of what was fitted. Shape (n,).
    """
    factor = max(1.0, float(np.nanmax(surprise)))
    return replace(fit, covariance=factor**2 * fit.covariance)


def _known_rows(steady: Identified, base: BaseParameters, gravity_only: bool = False) -> tuple[Floats, Floats]:
    """Rows and values, of deviation 1, of what steady passes tell of gravity and friction, or of gravity alone."""
    gravity, rubs = len(steady.base.leading), steady.unknowns.n_friction
    first = steady.unknowns.n_weights
    chosen = np.r_[:gravity] if gravity_only else np.r_[:gravity, first : first + rubs]
    covariance = steady.fit.covariance[np.ix_(chosen, chosen)]
    whiten = np.linalg.cholesky(np.linalg.inv(covariance)).T
    rows = np.zeros((len(chosen), len(base.leading) + rubs))
    rows[:gravity, : len(base.leading)] = _gravity_of(steady.base, base)
    if not gravity_only:
        rows[gravity:, len(base.leading) :] = np.eye(rubs)
    return whiten @ rows, whiten @ steady.compensated[chosen]


def _gravity_of(gravity: BaseParameters, whole: BaseParameters) -> Floats:
    """Base parameters of gravity out of all base parameters: the same combinations of links. Shape (g, b)."""
    links = len(whole.names) // len(PER_LINK)
    K = np.zeros((len(gravity.leading), links, len(PER_LINK)))
    K[:, :, :OF_GRAVITY] = gravity.K.reshape(-1, links, OF_GRAVITY)
    return np.asarray(K.reshape(len(K), -1)[:, list(whole.leading)])


def _bodies(robot: Robot, base: BaseParameters, fit: Fit) -> Links:
    b = len(base.leading)
    return nearest_bodies(robot, base, fit.values[:b], fit.covariance[:b, :b])


def _beta(robot: Robot, base: BaseParameters, regressor: Regressor, links: Links) -> Floats:
    return np.asarray(base.K @ known_parameters(robot.model_copy(update={"links": links}), regressor))


def _error(steady: Identified, rows: MotionRows, beta: Floats, friction: Floats) -> Floats:
    """Rms error of the predicted torque over rows, by motor. Shape (n,)."""
    moved = steady.scale[rows.motor] * (rows.columns @ beta + rows.rotors)
    predicted = (
        moved + steady.unknowns.friction_jacobian(rows.motor, rows.rate) @ friction + _stribeck_torque(steady, rows)
    )
    return rms_by_motor(rows.torque - predicted, rows.motor, steady.robot.n)


def _stribeck_torque(steady: Identified, rows: MotionRows) -> Floats:
    """Torque of Stribeck's excess, as steady passes tell it. Shape (m,)."""
    return steady.unknowns.stribeck_torque(rows.motor, rows.rate, steady.unknowns.parts(steady.fit.values).remainder)


def _descriptions(robot: Robot, regressor: Regressor, base: BaseParameters) -> Iterator[Description]:
    yield from of_base(base, base.K @ known_parameters(robot, regressor))
    yield from of_friction(robot)
