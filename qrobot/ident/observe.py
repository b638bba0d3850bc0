"""From a log to observations: the mean torque of every motor while it turned steadily.

At constant speed nothing accelerates: what a motor gives is gravity and friction, and a little centrifugal torque that
the robot file knows well enough; where it is more than that the motor is left out, and so it is where it turns so
slowly that friction is another. The equations are linear in what is sought, so the mean of a whole pass obeys them as
every sample does, without its quantisation. Passes are found in the log itself; whoever moved the arm need not say.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from numpy.typing import NDArray

from qrobot.config import Robot
from qrobot.hwif.registers import DAC_ZERO
from qrobot.ident.base import BaseParameters
from qrobot.ident.regressor import Regressor
from qrobot.model.dynamics import dynamics_params, dynamics_work, inverse_dynamics
from qrobot.servo.modes import Mode
from qrobot.servo.telemetry import Rows

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

CRUISE: Final = 0.05  # rad/s2, m/s2: smaller desired accelerations are none
TRANSITIONS: Final = 2.5  # times the friction's transition speed: slower motors tell nothing of their friction
SLOWEST: Final = 0.06  # of a joint's greatest speed: below, friction falls with speed (Stribeck) and is not fitted
KNOWN: Final = 0.02  # of a motor's Coulomb friction: a larger centrifugal torque, a third of it wrong, would show
SETTLING_S: Final = 0.2  # of a pass left out: its start still shows the acceleration before
SHORTEST_S: Final = 0.2  # of what is left
EVERY: Final = 10  # rows: positions change too little between neighbours for gravity to
DAC_MARGIN: Final = 2  # counts within which a DAC word is at its end


@dataclass(frozen=True)
class Pass:
    """Rows `start` to `stop` of a log, in which nothing accelerates."""

    start: int
    stop: int


@dataclass(frozen=True, eq=False)
class Observations:
    """One row for each motor and pass; motor side, joint units.

    Attributes:
        motor: which, from 0. Shape (m,).
        passed: number of the pass. Shape (m,).
        gravity: what multiplies the base parameters. Shape (m, b).
        rate: mean speed, rad/s (m/s). Shape (m,).
        torque: mean torque, less that of inertia, N m (N). Shape (m,).
    """

    motor: Ints
    passed: Ints
    gravity: Floats
    rate: Floats
    torque: Floats

    def __len__(self) -> int:
        return len(self.motor)

    def only(self, chosen: Bools) -> Observations:
        """The rows that are chosen, shape (m,)."""
        return Observations(*(getattr(self, field.name)[chosen] for field in fields(self)))


def steady_passes(rows: Rows, period_s: float) -> list[Pass]:
    """Passes of a log, shape (rows,), in which the arm tracks setpoints that do not accelerate it.

    A pass ends where a torque is at its limit, where a frame was missed, and where rows are lost.
    """
    limited = ((rows["dac"] <= DAC_MARGIN) | (rows["dac"] >= 2 * DAC_ZERO - 1 - DAC_MARGIN)).any(axis=1)
    moves = (rows["v_ref"] != 0.0).any(axis=1)
    calm = (np.abs(rows["a_ref"]) < CRUISE).all(axis=1)
    good = (rows["mode"] == Mode.TRACKING) & calm & moves & ~limited & (rows["flags"] >> 8 == 0)
    good[1:] &= np.diff(rows["tick"]) == 1
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(np.int8)))
    skip, shortest = round(SETTLING_S / period_s), round(SHORTEST_S / period_s)
    found = zip((edges[::2] + skip).tolist(), edges[1::2].tolist(), strict=True)
    return [Pass(start, stop) for start, stop in found if stop - start >= shortest]


class Observer:
    """Reduces the passes of one robot.

    Args:
        robot: whose log it is.
        regressor: of its gravity.
        base: parameters of the regressor.
    """

    def __init__(self, robot: Robot, regressor: Regressor, base: BaseParameters) -> None:
        self._robot, self._regressor, self._base = robot, regressor, base
        self._to_motor = np.linalg.inv(robot.transmission.coupling.T)
        self._params = dynamics_params(robot)._replace(gravity=np.zeros(3))
        preset = robot.friction[robot.control.friction_preset]
        self._most = KNOWN * (preset.coulomb_pos + preset.coulomb_neg)
        self._slowest = np.maximum(TRANSITIONS * robot.control.friction_velocity, SLOWEST * robot.limits.v_max)

    def observe(self, rows: Rows, period_s: float) -> Observations:
        """The observations of a log, rows of shape (r,)."""
        parts = [self._reduce(rows[p.start : p.stop], i) for i, p in enumerate(steady_passes(rows, period_s))]
        return _stacked(parts, len(self._base.leading))

    def _reduce(self, rows: Rows, number: int) -> Observations:
        q, rate = rows["q"], rows["v_ref"] @ self._robot.transmission.coupling.T
        columns = self._base.columns(self._regressor(q[EVERY // 2 :: EVERY])).mean(axis=0)
        given = ((rows["dac"] - DAC_ZERO) / self._robot.transmission.dac_per_Nm).mean(axis=0)
        centrifugal = self._to_motor @ self._centrifugal(q.mean(axis=0), rows["v_ref"].mean(axis=0))
        torque = given - centrifugal
        tells = (np.abs(rate).min(axis=0) > self._slowest) & (np.abs(centrifugal) < self._most)
        turning = np.flatnonzero(tells)
        mean_rate = rate.mean(axis=0)
        numbers = np.full(turning.size, number)
        return Observations(turning, numbers, (self._to_motor @ columns)[turning], mean_rate[turning], torque[turning])

    def _centrifugal(self, q: Floats, v: Floats) -> Floats:
        tau = np.zeros(q.size)
        inverse_dynamics(q, v, np.zeros(q.size), self._params, dynamics_work(q.size), tau)
        return tau


def _stacked(parts: list[Observations], n_base: int) -> Observations:
    none = np.zeros(0, np.int64)
    empty = Observations(none, none, np.zeros((0, n_base)), np.zeros(0), np.zeros(0))
    return Observations(*(np.concatenate([getattr(p, f.name) for p in (empty, *parts)]) for f in fields(empty)))
