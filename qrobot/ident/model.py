"""Gravity and friction of an arm, estimated from observations and judged on some that were held back."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from qrobot.config import Robot
from qrobot.errors import IdentificationError
from qrobot.ident.base import BaseParameters
from qrobot.ident.fit import Fit, fit_linear
from qrobot.ident.friction import FRICTION_NAMES, friction_columns
from qrobot.ident.observe import Observations
from qrobot.ident.regressor import Regressor, known_parameters

Floats = NDArray[np.float64]

HELD_BACK: Final = 5  # every fifth pass is not fitted at first, but predicted


@dataclass(frozen=True)
class Value:
    """One identified number: `half_width` is that of its 95 % interval, `before` what the robot file says."""

    name: str
    meaning: str
    unit: str
    value: float
    half_width: float
    before: float

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return dict(vars(self))


@dataclass(frozen=True, eq=False)
class Identified:
    """What was found out about an arm.

    Attributes:
        robot: the robot file before.
        base: what of gravity can be told.
        fit: of the base parameters, then viscous and the two Coulomb frictions of each motor.
        observations: what was fitted.
        held_back_rms: error of the prediction of passes held back, motor side, N m (N). Shape (n,).
        before_rms: error of the robot file's prediction of the same passes. Shape (n,).
    """

    robot: Robot
    base: BaseParameters
    regressor: Regressor
    fit: Fit
    observations: Observations
    held_back_rms: Floats
    before_rms: Floats

    @property
    def beta(self) -> Floats:
        """Base parameters of gravity, kg m (kg for masses). Shape (b,)."""
        return self.fit.values[: len(self.base.leading)]

    @property
    def friction(self) -> Floats:
        """Viscous, Coulomb of positive and of negative motion, by motor. Shape (n, 3)."""
        return self.fit.values[len(self.base.leading) :].reshape(self.robot.n, len(FRICTION_NAMES))

    def gravity(self, q: Floats) -> Floats:
        """Torques that hold the arm at positions of shape (m, n), N m (N). Shape (m, n)."""
        return np.asarray(self.base.columns(self.regressor(q)) @ self.beta)

    @property
    def values(self) -> list[Value]:
        """Everything, with its uncertainty and what the robot file says."""
        before = _known(self.robot, self.base, self.regressor)
        found = zip(self.fit.values.tolist(), self.fit.half_width.tolist(), before.tolist(), strict=True)
        return [
            Value(name, meaning, unit, *numbers)
            for (name, meaning, unit), numbers in zip(_descriptions(self.robot, self.base), found, strict=True)
        ]


def identify(robot: Robot, base: BaseParameters, regressor: Regressor, observations: Observations) -> Identified:
    """Estimate gravity and friction.

    Raises:
        IdentificationError: the observations do not determine them; says what is missing.
    """
    if not len(observations):
        raise IdentificationError("nothing recorded moves steadily: record the passes of `qrobot identify plan`")
    names = [name for name, _, _ in _descriptions(robot, base)]
    A = _columns(robot, observations)
    held = observations.passed % HELD_BACK == HELD_BACK - 1
    trial = fit_linear(
        A[~held], observations.torque[~held], observations.motor[~held], names, observations.doubt[~held]
    )
    before = _known(robot, base, regressor)
    motor, torque = observations.motor[held], observations.torque[held]
    return Identified(
        robot,
        base,
        regressor,
        fit_linear(A, observations.torque, observations.motor, names, observations.doubt),
        observations,
        _rms_by_motor(torque - A[held] @ trial.values, motor, robot.n),
        _rms_by_motor(torque - A[held] @ before, motor, robot.n),
    )


def _columns(robot: Robot, observations: Observations) -> Floats:
    """What multiplies the base parameters, then the friction of each motor."""
    m, own = len(observations), len(FRICTION_NAMES)
    rate = np.zeros((m, robot.n))
    rate[np.arange(m), observations.motor] = observations.rate
    friction = friction_columns(rate, robot.control.friction_velocity)
    return np.column_stack([observations.gravity, friction.reshape(m, robot.n * own)])


def _rms_by_motor(error: Floats, motor: NDArray[np.int64], n: int) -> Floats:
    """Root mean square, NaN where there is nothing to judge by. Shape (n,)."""
    squares, counts = np.bincount(motor, error**2, n), np.bincount(motor, minlength=n)
    return np.sqrt(np.where(counts > 0, squares, np.nan) / np.maximum(counts, 1))


def _known(robot: Robot, base: BaseParameters, regressor: Regressor) -> Floats:
    preset = robot.friction[robot.control.friction_preset]
    friction = np.column_stack([getattr(preset, name) for name in FRICTION_NAMES])
    return np.concatenate([base.K @ known_parameters(robot, regressor), friction.ravel()])


def _descriptions(robot: Robot, base: BaseParameters) -> Iterator[tuple[str, str, str]]:
    """Name, meaning and unit of each column."""
    for index, name in enumerate(base.leaders):
        yield name, base.combination(index), "kg" if name.startswith("m") else "kg m"
    for joint, slides in zip(robot.joint_names, robot.prismatic, strict=True):
        force, speed = ("N", "m/s") if slides else ("N m", "rad/s")
        for symbol in FRICTION_NAMES:
            unit = f"{force}/({speed})" if symbol == "viscous" else force
            yield f"{joint}.{symbol}", f"{symbol} friction of motor {joint}", unit
