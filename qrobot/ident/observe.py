"""Observations out of a log: the mean torque of every motor while it turned steadily.

At constant speed hardly anything accelerates: what a motor gives is gravity and friction, and a little inertial torque
that the robot file knows roughly. What of it may be wrong is the same inertia in every pass, no chance of each: an
observation has the torque of each parameter's likely error, and the fit seeks them beside the rest. A motor is left out
where it turns so slowly that its friction is another. The equations are linear in what is sought, so a mean over a
whole pass obeys them as every sample does, without its quantisation; one over a smooth window (`window`), which takes
nothing from what still decays at the ends. Passes are found in the log itself, whatever program moved the arm.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np

from qrobot.arrays import Bools, Floats, Ints
from qrobot.config import Robot
from qrobot.hwif.registers import DAC_ZERO
from qrobot.ident.base import BaseParameters, base_of_robot
from qrobot.ident.dropouts import between_cycles, measured_positions
from qrobot.ident.recording import sound
from qrobot.ident.regressor import OF_GRAVITY, Regressor, inertial_regressor, known_parameters
from qrobot.ident.window import Weights, subsample, window_weights
from qrobot.modecodes import Mode
from qrobot.model.dynamics import dynamics_params, dynamics_work, inverse_dynamics
from qrobot.servo.memory.telemetry import Rows

CRUISE: Final = 0.05  # rad/s2, m/s2: smaller desired accelerations are none
TRANSITIONS: Final = 2.5  # times the friction's transition speed: slower motors tell nothing of their friction
SLOWEST: Final = 0.06  # of a joint's greatest speed: below, friction falls with speed (Stribeck) and is not fitted
DOUBT: Final = 0.01  # share of the inertial torque that no inertia explains: a mean over a pass at nine places
INERTIA_DOUBT: Final = (
    0.5  # share of mass, first moment and inertia that may be wrong: links are drawn, not weighed [A]
)
SCALE_DOUBT: Final = 0.3  # of a torque scale: two motors, whose published torque constants differ by 15 to 24 %
LOAD_KG: Final = 2.5  # what the hand may hold, a PUMA's greatest load
RESOLUTION: Final = 0.05  # DAC counts: the mean torque of a pass is not known better
SETTLING_S: Final = 0.2  # of a pass left out: its start still shows the acceleration before
SHORTEST_S: Final = 0.2  # of what is left
EVERY: Final = 10  # rows: positions change too little between neighbours for gravity to
HARMONICS: Final = 12  # of a turn in joint units; those beyond are averaged away by most passes
_NO_WEIGHT: Final = 1e-9  # m/s2, m2/s2: rounding
SUBSAMPLES: Final = 9  # at the inertial torque along a pass


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
        time_s: middle of the pass, from the first row of the first log. Shape (m,).
        q: mean position of the joints, rad (m). Shape (m, n).
        gravity: what multiplies the base parameters. Shape (m, b).
        gravity_parts: that mean's parts along the pass, whose sum it is nearly. Shape (m, SUBSAMPLES, b).
        load: what multiplies mass and first moment of a load on the last link. Shape (m, 4).
        loaded: whether it was carried. Shape (m,).
        rate: mean speed, rad/s (m/s). Shape (m,).
        harmonics: means of cos(k r), then of sin(k r), of the motor's angle r, k = 1 to HARMONICS. Shape (m, 2 k).
        torque: mean torque, less that of inertia, N m (N). Shape (m,).
        doubt: standard deviation of what inertia was thought to take, N m (N). Shape (m,).
        inertia: torque that inertia takes more than was thought for a likely error of each of its parameters, and of
            each motor's torque scale, N m (N). Shape (m, i).
    """

    motor: Ints
    passed: Ints
    time_s: Floats
    q: Floats
    gravity: Floats
    gravity_parts: Floats
    load: Floats
    loaded: Bools
    rate: Floats
    harmonics: Floats
    torque: Floats
    doubt: Floats
    inertia: Floats

    def __len__(self) -> int:
        return len(self.motor)

    def only(self, chosen: Bools) -> Observations:
        """The rows that are chosen, shape (m,)."""
        return Observations(*(getattr(self, field.name)[chosen] for field in fields(self)))

    def followed_by(self, others: Observations) -> Observations:
        """Join these passes and others of the same arm, whose time goes on where these end."""
        passed, time_s = 1 + self.passed.max(initial=-1), self.time_s.max(initial=0.0)
        later = replace(others, passed=others.passed + passed, time_s=others.time_s + time_s)
        parts = ((getattr(self, field.name), getattr(later, field.name)) for field in fields(self))
        return Observations(*map(np.concatenate, parts))


def steady_passes(rows: Rows, period_s: float) -> list[Pass]:
    """Passes of a log, shape (rows,), in which the arm tracks setpoints that do not accelerate it.

    A pass ends where a torque is at its limit, where a frame was missed, where rows are lost, where images are, and
    where a joint is led by hand.
    """
    moves = (rows["v_ref"] != 0.0).any(axis=1)
    calm = (np.abs(rows["a_ref"]) < CRUISE).all(axis=1)
    good = (rows["mode"] == Mode.TRACKING) & calm & moves & sound(rows, period_s)
    good[1:] &= np.diff(rows["tick"]) == 1
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(np.int8)))
    skip, shortest = round(SETTLING_S / period_s), round(SHORTEST_S / period_s)
    found = zip((edges[::2] + skip).tolist(), edges[1::2].tolist(), strict=True)
    return [Pass(start, stop) for start, stop in found if stop - start >= shortest]


def slowest_rates(robot: Robot) -> Floats:
    """Speeds of motors above which friction is what the servo compensates. Shape (n,)."""
    return np.maximum(TRANSITIONS * robot.control.friction_velocity, SLOWEST * robot.limits.v_max)


class Observer:
    """Reduces the passes of one robot.

    Args:
        robot: whose log it is.
        regressor: of its gravity.
        base: parameters of the regressor.
        believed: the same robot with better links, for the inertial torque.
        scale: torque scales of its motors, for the same; default 1. Shape (n,).
        slowest: speeds above which a motor is observed; default where friction has lost Stribeck's share. Shape (n,).
    """

    def __init__(
        self,
        robot: Robot,
        regressor: Regressor,
        base: BaseParameters,
        believed: Robot | None = None,
        scale: Floats | None = None,
        slowest: Floats | None = None,
    ) -> None:
        self._robot, self._regressor, self._base = robot, regressor, base
        self._to_motor = np.linalg.inv(robot.transmission.coupling.T)
        self._whole = inertial_regressor(robot)
        self._inertia = base_of_robot(robot, self._whole)
        self._wrong = _likely_errors(robot, self._whole, self._inertia)
        middle = 0.5 * (robot.limits.q_min + robot.limits.q_max)
        anywhere = middle + np.linspace(-0.4, 0.3, 5)[:, None] * (robot.limits.q_max - robot.limits.q_min)
        self._bears = np.abs(self._to_motor @ regressor(anywhere)).max(axis=(0, 2)) > _NO_WEIGHT
        self._scale = np.ones(robot.n) if scale is None else scale
        self._params = dynamics_params(believed or robot)._replace(gravity=np.zeros(3))
        self._slowest = slowest_rates(robot) if slowest is None else slowest

    def observe(self, rows: Rows, period_s: float, loaded: bool = False) -> Observations:
        """The observations of a log, rows of shape (r,), of an arm that is `loaded` or not."""
        passes, q = enumerate(steady_passes(rows, period_s)), measured_positions(rows)
        parts = [self._reduce(rows, q, p, number, period_s, loaded) for number, p in passes]
        return _stacked([none_of(self._robot.n, len(self._base.leading), 2 * len(self._wrong) + self._robot.n), *parts])

    def _reduce(
        self, log: Rows, measured: Floats, steady: Pass, number: int, period_s: float, loaded: bool
    ) -> Observations:
        part, transmission = slice(steady.start, steady.stop), self._robot.transmission
        rows, q = log[part], between_cycles(measured[part])
        turning = np.flatnonzero(np.abs(rows["v_ref"] @ transmission.coupling.T).min(axis=0) > self._slowest)
        window = window_weights(len(q), period_s)
        looks = subsample(window, 1 + len(q) // EVERY)
        Y = self._to_motor @ np.tensordot(looks.share, self._regressor(q[looks.at]), 1)
        given = window.value @ (rows["dac"][:-1] - DAC_ZERO) / transmission.dac_per_Nm
        v = window.slope @ q
        inertial = self._scale * (self._to_motor @ self._inertial(q, v, window))
        doubt = np.hypot(DOUBT * inertial, RESOLUTION / transmission.dac_per_Nm)
        return Observations(
            motor=turning,
            passed=np.full(turning.size, number),
            time_s=np.full(turning.size, 0.5 * period_s * (steady.start + steady.stop)),
            q=np.tile(window.value @ q, (turning.size, 1)),
            gravity=self._base.columns(Y)[turning],
            gravity_parts=self._parts(q, window)[:, turning].swapaxes(0, 1),
            load=Y[turning, -OF_GRAVITY:],
            loaded=np.full(turning.size, loaded),
            rate=(transmission.coupling @ v)[turning],
            harmonics=np.tensordot(looks.share, harmonics(self._robot, q[looks.at]), 1)[turning],
            torque=(given - inertial)[turning],
            doubt=doubt[turning],
            inertia=self._of_inertia(q, v, window, inertial)[turning],
        )

    def _of_inertia(self, q: Floats, v: Floats, window: Weights, inertial: Floats) -> Floats:
        """Mean torque of likely errors: of inertia, as the motors that bear weight feel it and as the others do, whose
        torque scale weight does not tell; and of each scale, of the `inertial` torque (n,). Shape (n, i).
        """
        looks = subsample(window, SUBSAMPLES)
        at, still = q[looks.at], np.zeros((SUBSAMPLES, v.size))
        moved = self._whole(at, still + v, still + window.curvature @ q) - self._whole(at)
        columns = self._inertia.columns(np.tensordot(looks.share, moved, 1))
        torque = self._scale[:, None] * (self._to_motor @ columns) * self._wrong
        bears = self._bears[:, None]
        return np.column_stack([bears * torque, ~bears * torque, np.diag(SCALE_DOUBT * inertial)])

    def _parts(self, q: Floats, window: Weights) -> Floats:
        """Means of the base parameters' columns over positions of shape (r, n). Shape (SUBSAMPLES, n, b)."""
        looks = subsample(window, SUBSAMPLES)
        return np.asarray(
            looks.share[:, None, None] * self._base.columns(self._to_motor @ self._regressor(q[looks.at]))
        )

    def _inertial(self, q: Floats, v: Floats, window: Weights) -> Floats:
        """Mean torque beside gravity of moving at `v` (n,) through positions of shape (r, n)."""
        n, looks = v.size, subsample(window, SUBSAMPLES)
        a, tau, work = window.curvature @ q, np.zeros((SUBSAMPLES, n)), dynamics_work(n)
        for at, torque in zip(q[looks.at], tau, strict=True):
            inverse_dynamics(at, v, a, self._params, work, torque)
        return np.asarray(looks.share @ tau)


def _likely_errors(robot: Robot, whole: Regressor, base: BaseParameters) -> Floats:
    """Standard deviations of the base parameters of inertia: links are drawn, and something may be in the hand."""
    flange_m = robot.geometry.flange_m
    likely = INERTIA_DOUBT * np.abs(known_parameters(robot, whole)).reshape(robot.n, -1)
    likely[-1] += LOAD_KG * np.array([1.0, 0.0, 0.0, flange_m, flange_m**2, flange_m**2, 0.0, 0.0, 0.0, 0.0])
    return np.asarray(np.sqrt(((base.K * likely.ravel()) ** 2).sum(axis=1)))


def none_of(n: int, n_base: int, n_inertia: int = 0) -> Observations:
    """No observations, of an arm with so many joints and base parameters of gravity and of inertia."""
    none, nothing = np.zeros(0, np.int64), np.zeros(0)
    columns = np.zeros((0, n)), np.zeros((0, n_base)), np.zeros((0, SUBSAMPLES, n_base)), np.zeros((0, OF_GRAVITY))
    waves = np.zeros((0, 2 * HARMONICS))
    unloaded, inertia = np.zeros(0, np.bool_), np.zeros((0, n_inertia))
    return Observations(none, none, nothing, *columns, unloaded, nothing, waves, nothing, nothing, inertia)


def harmonics(robot: Robot, q: Floats) -> Floats:
    """cos(k r), then sin(k r), of the angle r of each motor in joint units, at positions (..., n). Shape (..., n, 2 k).

    The angle of a motor that slides a joint goes once round over the joint's range.
    """
    turn = np.where(robot.prismatic, robot.limits.q_max - robot.limits.q_min, 2.0 * np.pi)
    angle = (2.0 * np.pi / turn * (q @ robot.transmission.coupling.T))[..., None] * np.arange(1, HARMONICS + 1)
    return np.concatenate([np.cos(angle), np.sin(angle)], axis=-1)


def _stacked(parts: list[Observations]) -> Observations:
    return Observations(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Observations)))
