"""Unknowns of an identification, and their order in its fit.

Motor i has to be commanded u_i = s_i (Y_i beta) + friction_i, in torque as the robot file's `dac_per_Nm` commands it:

    beta        base parameters of gravity, then those of a load that some of the passes carried
    friction    viscous and the two Coulomb frictions of each motor
    s           torque scales: what motor i is commanded for a torque of 1. Some are sought, the others are 1
    remainder   of Stribeck's excess, part of friction_i; no law has it, but without it the others would be bent
    drift       share by which friction_i rose from the beginning of a recording to its end, as motors warm up
    terms       of friction that varies otherwise with position, speed or load, where that shows (`terms`)
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from qrobot.arrays import Bools, Floats, Ints
from qrobot.config import Robot
from qrobot.ident.base import BaseParameters
from qrobot.ident.friction import (
    FRICTION_NAMES,
    REMAINDER_NAMES,
    REMAINDER_SPEED,
    friction_columns,
    remainder_columns,
)
from qrobot.ident.observe import SCALE_DOUBT, Observations
from qrobot.ident.regressor import Regressor, known_parameters
from qrobot.ident.terms import Terms

DRIFT_DOUBT: Final = 0.1  # of friction, over a recording: of a cold arm it changes more, and then the passes tell
REMAINDER_DOUBT: Final = 0.05  # of Coulomb friction: an excess of a half that fades at 3 % of the greatest speed
LEAST_FRICTION: Final = 1e-3  # N m (N), where a robot file has none
OF_LOAD: Final = ("load.m", "load.hx", "load.hy", "load.hz")
_UNITS: Final = {"m": "kg", "h": "kg m", "I": "kg m2"}


class Description(NamedTuple):
    """Name, meaning and unit of one unknown, and what the robot file says of it."""

    name: str
    meaning: str
    unit: str
    before: float


class UnknownValues(NamedTuple):
    """Values of one kind each: base parameters of arm and load, then by motor; of some motors the scales only."""

    weights: Floats
    friction: Floats
    scales: Floats
    remainder: Floats
    drift: Floats
    terms: Floats


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Unknown parameters of an arm.

    Attributes:
        robot: the robot file before.
        regressor: of its gravity.
        base: parameters of the regressor that can be told.
        load: those of a load, none when nothing was carried.
        free: motors whose torque scales are sought.
        seconds: that the recording took.
        terms: of friction, beside those that are always sought.
    """

    robot: Robot
    regressor: Regressor
    base: BaseParameters
    load: BaseParameters | None = None
    free: tuple[int, ...] = ()
    seconds: float = 1.0
    terms: Terms | None = None

    @property
    def n_terms(self) -> int:
        """Number of coefficients of the terms."""
        return 0 if self.terms is None else len(self.terms.deviation)

    @property
    def n_weights(self) -> int:
        """Number of base parameters, those of a load included."""
        return len(self.base.leading) + (len(self.load.leading) if self.load else 0)

    @property
    def n_friction(self) -> int:
        """Number of parameters of friction."""
        return self.robot.n * len(FRICTION_NAMES)

    @property
    def names(self) -> list[str]:
        """Names of all unknowns, for complaints."""
        return [description.name for description in self.descriptions()]

    def parts(self, values: Floats) -> UnknownValues:
        """Values (p,) by their kind; friction (n, 3), remainder (n, 2) and drift (n,) by motor."""
        n = self.robot.n
        sizes = self.n_weights, self.n_friction, len(self.free), n * len(REMAINDER_NAMES), n
        weights, friction, scales, remainder, drift, terms = np.split(values, np.cumsum(sizes))
        return UnknownValues(weights, friction.reshape(n, -1), scales, remainder.reshape(n, -1), drift, terms)

    def scale(self, values: Floats) -> Floats:
        """Torque scale of each motor. Shape (n,)."""
        scale = np.ones(self.robot.n)
        scale[list(self.free)] = self.parts(values).scales
        return scale

    def weights(self, observations: Observations) -> Floats:
        """Columns of the base parameters of arm and load. Shape (m, n_weights)."""
        if self.load is None:
            return observations.gravity
        carried = observations.load[:, list(self.load.leading)] * observations.loaded[:, None]
        return np.column_stack([observations.gravity, carried])

    def friction_jacobian(self, motor: Ints, rate: Floats) -> Floats:
        """Columns of the friction of motors (m,) at speeds (m,). Shape (m, n_friction)."""
        columns = friction_columns(self._own(motor, rate), self.robot.control.friction_velocity)
        return columns.reshape(len(motor), self.n_friction)

    def start(self) -> Floats:
        """Unknowns of an arm without weight and friction whose motors give what they are asked for. Shape (p,)."""
        n, linear = self.robot.n, self.n_weights + self.n_friction
        rest = n * (len(REMAINDER_NAMES) + 1) + self.n_terms
        return np.concatenate([np.zeros(linear), np.ones(len(self.free)), np.zeros(rest)])

    def doubt(self) -> Floats:
        """Standard deviation of `start` as it is believed beforehand; infinity where nothing is. Shape (p,)."""
        preset = self.robot.friction[self.robot.control.friction_preset]
        coulomb = np.maximum(np.column_stack([preset.coulomb_pos, preset.coulomb_neg]), LEAST_FRICTION)
        linear, scales = np.full(self.n_weights + self.n_friction, np.inf), np.full(len(self.free), SCALE_DOUBT)
        terms = np.zeros(0) if self.terms is None else self.terms.deviation
        drift = np.full(self.robot.n, DRIFT_DOUBT)
        return np.concatenate([linear, scales, REMAINDER_DOUBT * coulomb.ravel(), drift, terms])

    def predict(self, values: Floats, observations: Observations) -> Floats:
        """Commanded torque of each observation, motor side. Shape (m,)."""
        weight = self.weights(observations) @ self.parts(values).weights
        changed = self._changed(values, observations)
        of_terms = self.term_columns(observations) @ self.parts(values).terms
        return np.asarray(
            self.scale(values)[observations.motor] * weight + changed * self._friction(values, observations) + of_terms
        )

    def term_columns(self, observations: Observations) -> Floats:
        """Columns of the coefficients of the terms. Shape (m, n_terms)."""
        if self.terms is None:
            return np.zeros((len(observations), 0))
        return self.terms.columns(self.robot, observations, self.weights(observations))

    def stribeck_torque(self, motor: Ints, rate: Floats, remainder: Floats) -> Floats:
        """Torque that Stribeck's remainders (n, 2) add to motors (m,) at speeds (m,). Shape (m,)."""
        return np.asarray(self._remainders(motor, rate) @ remainder.ravel())

    def jacobian(self, values: Floats, observations: Observations) -> Floats:
        """Derivative of the prediction by the values. Shape (m, p)."""
        motor, rate, weights = observations.motor, observations.rate, self.weights(observations)
        scaled = self.scale(values)[motor, None] * weights
        by_scale = self._own(motor, weights @ self.parts(values).weights)[:, list(self.free)]
        changed = self._changed(values, observations)[:, None]
        by_drift = self._own(motor, self._when(observations) * self._friction(values, observations))
        return np.column_stack(
            [
                scaled,
                changed * self.friction_jacobian(motor, rate),
                by_scale,
                changed * self._remainders(motor, rate),
                by_drift,
                self.term_columns(observations),
            ]
        )

    def before(self) -> Floats:
        """Values of the robot file, and zero for a load. Shape (p,)."""
        return np.array([description.before for description in self.descriptions()])

    def compensated(self, values: Floats, observations: Observations) -> Floats:
        """Matrix that makes of the values those that a servo has. Shape (p, p).

        It has no remainder, drift or terms. Where terms were sought, viscous and Coulomb friction are those that come
        nearest to friction and terms at the speeds and loads of these observations; viscous friction is never below
        zero. A ripple, whose mean over a turn is nothing, leaves none in them.
        """
        linear = self.n_weights + self.n_friction
        matrix = np.diag((np.arange(len(values)) < linear + len(self.free)).astype(np.float64))
        if self.terms is not None:
            nearest = self._nearest_friction(self.terms, observations, np.ones(self.n_friction, np.bool_))
            rubs = slice(self.n_weights, linear)
            both = np.r_[rubs, len(values) - self.n_terms : len(values)]
            rises = (nearest @ values[both]).reshape(-1, len(FRICTION_NAMES)) >= 0.0
            rises[:, 1:] = True
            matrix[rubs, both] = self._nearest_friction(self.terms, observations, rises.ravel())
        return matrix

    def _nearest_friction(self, terms: Terms, observations: Observations, sought: Bools) -> Floats:
        """Friction nearest to friction and terms, by both; zero where it is not sought (n_friction,)."""
        rubs = self.friction_jacobian(observations.motor, observations.rate)
        lasting = [terms.sought[owner].kind != "position" for owner in terms.owner.tolist()]
        nearest = np.zeros((self.n_friction, self.n_friction + self.n_terms))
        both = np.column_stack([rubs, self.term_columns(observations) * lasting])
        nearest[sought] = np.linalg.lstsq(rubs[:, sought], both)[0]
        return nearest

    def descriptions(self) -> Iterator[Description]:
        """Descriptions of the unknowns in turn."""
        yield from of_base(self.base, self.base.K @ known_parameters(self.robot, self.regressor))
        if self.load is not None:
            yield from of_base(self.load, np.zeros(len(self.load.leading)))
        yield from of_friction(self.robot)
        for motor in self.free:
            name = self.robot.joint_names[motor]
            yield Description(f"{name}.torque_scale", f"torque commanded of {name} for a torque of 1", "", 1.0)
        yield from _of_remainders(self.robot)
        for name in self.robot.joint_names:
            yield Description(f"{name}.drift", f"share by which friction of motor {name} rose while recording", "", 0.0)
        for name, meaning, unit in () if self.terms is None else self.terms.names(self.robot):
            yield Description(name, meaning, unit, 0.0)

    def _friction(self, values: Floats, observations: Observations) -> Floats:
        """Friction of each observation, as it is in the middle of the recording. Shape (m,)."""
        motor, rate, parts = observations.motor, observations.rate, self.parts(values)
        steady = self.friction_jacobian(motor, rate) @ parts.friction.ravel()
        return np.asarray(steady + self.stribeck_torque(motor, rate, parts.remainder))

    def _changed(self, values: Floats, observations: Observations) -> Floats:
        """Friction at the time of each observation over that in the middle. Shape (m,)."""
        return np.asarray(1.0 + self.parts(values).drift[observations.motor] * self._when(observations))

    def _when(self, observations: Observations) -> Floats:
        """Time of each observation, from -1/2 at the beginning to 1/2 at the end. Shape (m,)."""
        return observations.time_s / self.seconds - 0.5

    def _remainders(self, motor: Ints, rate: Floats) -> Floats:
        """Columns of the remainders. Shape (m, n_remainder)."""
        columns = remainder_columns(self._own(motor, rate), self.robot.limits.v_max)
        return columns.reshape(len(motor), self.robot.n * len(REMAINDER_NAMES))

    def _own(self, motor: Ints, value: Floats) -> Floats:
        """Each value (m,) in the column of its motor. Shape (m, n)."""
        own = np.zeros((len(motor), self.robot.n))
        own[np.arange(len(motor)), motor] = value
        return own


def of_base(base: BaseParameters, before: Floats) -> Iterator[Description]:
    """Descriptions of base parameters, of which the robot file says `before` (b,)."""
    for index, (name, value) in enumerate(zip(base.leaders, before.tolist(), strict=True)):
        symbol = name.rpartition(".")[2][0]
        yield Description(name, base.combination(index), _UNITS[symbol], value)


def of_friction(robot: Robot) -> Iterator[Description]:
    """Descriptions of the friction of all motors."""
    preset = robot.friction[robot.control.friction_preset]
    for motor, (joint, slides) in enumerate(zip(robot.joint_names, robot.prismatic, strict=True)):
        force, speed = ("N", "m/s") if slides else ("N m", "rad/s")
        for symbol in FRICTION_NAMES:
            unit = f"{force}/({speed})" if symbol == "viscous" else force
            before = float(getattr(preset, symbol)[motor])
            yield Description(f"{joint}.{symbol}", f"{symbol} friction of motor {joint}", unit, before)


def _of_remainders(robot: Robot) -> Iterator[Description]:
    """Descriptions of the remainders of Stribeck's excess at one speed."""
    for joint, slides in zip(robot.joint_names, robot.prismatic, strict=True):
        for symbol in REMAINDER_NAMES:
            meaning = f"what friction of motor {joint} has more at {100 * REMAINDER_SPEED:.0f} % of its greatest speed"
            yield Description(f"{joint}.{symbol}", meaning, "N" if slides else "N m", 0.0)
