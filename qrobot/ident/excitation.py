"""Excitation of inertia: a few runs of Fourier motion, chosen for what they tell.

Of many random runs within range, speed, acceleration and torque, clear of the floor and of the arm itself, those are
chosen that together have the largest determinant of information of all base parameters (D-optimal, by exchange as the
poses of `plan`). Then each is changed a little at random for as long as that tells more. The same seed gives the same
runs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import IdentificationError
from qrobot.fences.fence_set import FenceSet
from qrobot.fences.gate import REACTION_S, way_of_stop
from qrobot.ident.base import BaseParameters
from qrobot.ident.clearance import Clearance
from qrobot.ident.fourier import Fourier, States
from qrobot.ident.plan import READY, TORQUE_SHARE, TRAVEL_SPEED, choose_informative, motor_columns
from qrobot.ident.regressor import Regressor, known_parameters
from qrobot.model.dynamics import dynamics_params

RUNS: Final = 4
RUN_S: Final = 8.0
HARMONICS: Final = 5
SPEED_SHARE: Final = 0.7  # of each joint's greatest speed and acceleration
RANGE_SHARE: Final = 0.9  # of a joint's range, about its middle
FEWEST: Final = 3  # runs: two to fit and one to hold back
SUBSAMPLES: Final = 65  # at a run, ends included: a dozen for each swing of the highest harmonic
_CANDIDATES: Final = 60
_DRAWS: Final = 20  # for each candidate, at most
_SMALLER: Final = (1.0, 0.7, 0.5)  # amplitudes that are tried
_CHANGES: Final = 15  # of each run
_CHANGE: Final = 0.2  # of its amplitudes


@dataclass(frozen=True, eq=False)
class FourierRun:
    """One motion of the plan; `by_ready` the way there goes by the pose `ready`."""

    name: str
    motion: Fourier
    by_ready: bool = False

    @property
    def centre(self) -> Floats:
        """Middle of what each joint goes through. Shape (n,)."""
        q = _states(self.motion).q
        return np.asarray(0.5 * (q.max(axis=0) + q.min(axis=0)))

    @property
    def half(self) -> Floats:
        """Half of that. Shape (n,)."""
        return np.asarray(0.5 * np.ptp(_states(self.motion).q, axis=0))


@dataclass(frozen=True, eq=False)
class Excitation:
    """Runs in the order in which they are made.

    Attributes:
        robot: name.
        runs: each from rest to rest.
        condition: of all base parameters along them, columns scaled to length 1.
        seconds: an estimate of the whole.
    """

    robot: str
    runs: tuple[FourierRun, ...]
    condition: float
    seconds: float

    @property
    def moves(self) -> tuple[FourierRun, ...]:
        """Moves in the order in which they are made."""
        return self.runs

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; amplitudes in rad (m)."""
        runs = [
            {"name": run.name, "seconds": run.motion.seconds, "centre": run.motion.centre.tolist()}
            | {"sine": run.motion.sine.tolist(), "cosine": run.motion.cosine.tolist()}
            for run in self.runs
        ]
        return {"robot": self.robot, "seconds": self.seconds, "condition": self.condition, "runs": runs}


def make_excitation(
    robot: Robot,
    regressor: Regressor,
    base: BaseParameters,
    runs: int = RUNS,
    seed: int = 0,
    fences: FenceSet | None = None,
) -> Excitation:
    """Choose runs for a robot.

    Args:
        robot: its file.
        regressor: of its inertia and gravity.
        base: parameters of the regressor.
        runs: how many.
        seed: of the random runs to choose from.
        fences: that the arm keeps off, beyond their margins, also where it is stopped in the middle of a run.

    Raises:
        IdentificationError: fewer runs are asked for than can be judged, `ready` is not clear, or too few runs are.
    """
    if runs < FEWEST:
        raise IdentificationError(f"{runs} runs are too few: at least {FEWEST}, of which one is held back")
    clearance = Clearance(robot, fences)
    clearance.check_ready(robot.poses[READY])
    search = _DesignSearch(robot, regressor, base, clearance, np.random.default_rng(seed))
    candidates = list(search.candidates())
    if len(candidates) < runs:
        raise IdentificationError(
            f"{len(candidates)} random runs are clear of floor, fences and the arm itself, {runs} are asked for"
        )
    columns = np.array([search.columns(motion) for motion in candidates])
    lengths = np.linalg.norm(columns, axis=(0, 1))
    chosen = [candidates[i] for i in choose_informative(columns / lengths, runs)]
    motions = search.improved(chosen, lengths)
    stacked = np.concatenate([search.columns(motion) for motion in motions])
    condition = float(np.linalg.cond(stacked / np.linalg.norm(stacked, axis=0)))
    named = tuple(_routed(robot, clearance, motions))
    return Excitation(robot.name, named, condition, _estimate(robot, named))


@dataclass(frozen=True, eq=False)
class _DesignSearch:
    """Draws runs and judges them."""

    robot: Robot
    regressor: Regressor
    base: BaseParameters
    clearance: Clearance
    random: np.random.Generator

    def candidates(self) -> Iterator[Fourier]:
        """Random runs that the arm may make."""
        found = 0
        for _ in range(_CANDIDATES * _DRAWS):
            shape = (2, self.robot.n, HARMONICS)
            sine, cosine = self.random.normal(size=shape) / np.arange(1.0, HARMONICS + 1.0)
            drawn = self._within(Fourier.from_rest(np.zeros(self.robot.n), sine, cosine, RUN_S))
            if drawn is not None:
                found += 1
                yield drawn
            if found == _CANDIDATES:
                return

    def columns(self, motion: Fourier) -> Floats:
        """Columns of the base parameters along a run, judged as the plan's poses are. Shape (looks n, b)."""
        Y = self.regressor(*_states(motion))
        columns = motor_columns(self.robot, self.base.columns(Y))
        return columns.reshape(-1, columns.shape[-1])

    def improved(self, motions: list[Fourier], lengths: Floats) -> list[Fourier]:
        """The same, each changed as long as all together tell more."""
        each = [self._information(motion, lengths) for motion in motions]
        best, found = float(np.linalg.slogdet(sum(each))[1]), list(motions)
        for place in [i for _ in range(_CHANGES) for i in range(len(motions))]:
            tried = self._changed(found[place])
            if tried is None:
                continue
            told = self._information(tried, lengths)
            others = [known for i, known in enumerate(each) if i != place]
            score = float(np.linalg.slogdet(sum([*others, told]))[1])
            if score > best:
                best, found[place], each[place] = score, tried, told
        return found

    def _information(self, motion: Fourier, lengths: Floats) -> Floats:
        columns = self.columns(motion) / lengths
        return np.asarray(columns.T @ columns)

    def _changed(self, motion: Fourier) -> Fourier | None:
        size = _CHANGE * np.sqrt(np.mean(motion.sine**2 + motion.cosine**2, axis=1, keepdims=True))
        sine, cosine = (old + size * self.random.normal(size=old.shape) for old in (motion.sine, motion.cosine))
        return self._within(Fourier.from_rest(motion.centre, sine, cosine, RUN_S), motion.centre)

    def _within(self, motion: Fourier, near: Floats | None = None) -> Fourier | None:
        """The motion as large as the joints allow, about a random centre or `near` one, if the arm may make it."""
        largest = motion.scaled(self._room(motion))
        swing = _states(largest).q - largest.centre
        limits = self.robot.limits
        middle, half = 0.5 * (limits.q_max + limits.q_min), 0.5 * RANGE_SHARE * (limits.q_max - limits.q_min)
        low, high = middle - half - swing.min(axis=0), middle + half - swing.max(axis=0)
        centre = self.random.uniform(low, np.maximum(low, high)) if near is None else np.clip(near, low, high)
        smaller = (Fourier(centre, largest.sine * share, largest.cosine * share, RUN_S) for share in _SMALLER)
        return next((tried for tried in smaller if self._may(tried)), None)

    def _room(self, motion: Fourier) -> Floats:
        """Factor by which each joint's amplitudes may grow. Shape (n,)."""
        limits, (q, v, a) = self.robot.limits, _states(motion)
        by_range = RANGE_SHARE * (limits.q_max - limits.q_min) / np.ptp(q, axis=0)
        by_rates = limits.v_max / np.abs(v).max(axis=0), limits.a_max / np.abs(a).max(axis=0)
        return np.asarray(np.minimum(by_range, SPEED_SHARE * np.minimum(*by_rates)))

    def _may(self, motion: Fourier) -> bool:
        """No torque is too large by the robot file, and the arm stays clear, between `ready` and the run too."""
        states = _states(motion)
        torque = np.abs(expected_torque(self.robot, self.regressor, states))
        light = bool((torque <= TORQUE_SHARE * self.robot.guard.tau_max).all())
        along = np.concatenate([self.robot.poses[READY][None], states.q])
        return light and self.clearance.of_path(along) and self._may_be_stopped(states)

    def _may_be_stopped(self, states: States) -> bool:
        """Whether the servo, which looks where a stop begun now would end, finds no fence there all along a run."""
        late_s = float(self.robot.control.stop_overshoot_s.max()) + REACTION_S
        rests = states.q + way_of_stop(states.v, self.robot.guard.a_stop, late_s)
        return all(map(self.clearance.of_fences, states.q, rests))


def expected_torque(robot: Robot, regressor: Regressor, states: States) -> Floats:
    """Torques of the motors, by the robot file, with friction against their motion. Shape (m, n)."""
    links = regressor(*states) @ known_parameters(robot, regressor) + states.a @ dynamics_params(robot).armature
    friction, rate = robot.friction[robot.control.friction_preset], states.v @ robot.transmission.coupling.T
    rubs = np.where(rate > 0.0, friction.coulomb_pos, -friction.coulomb_neg) + friction.viscous * rate
    return np.asarray(links @ np.linalg.inv(robot.transmission.coupling) + rubs)


def _states(motion: Fourier) -> States:
    return motion.at(np.linspace(0.0, motion.seconds, SUBSAMPLES))


def _routed(robot: Robot, clearance: Clearance, motions: list[Fourier]) -> Iterator[FourierRun]:
    """Moves by way of `ready`, which is clear for all, where the straight way to the next is not."""
    at = robot.poses[READY]
    for number, motion in enumerate(motions, 1):
        yield FourierRun(f"run {number}", motion, by_ready=not clearance.of_way(at, motion.start))
        at = motion.start


def _estimate(robot: Robot, runs: tuple[FourierRun, ...]) -> float:
    at, seconds = robot.poses[READY], 0.0
    for run in runs:
        stops = [at, robot.poses[READY], run.motion.start] if run.by_ready else [at, run.motion.start]
        seconds += sum(float((np.abs(b - a) / (TRAVEL_SPEED * robot.limits.v_max)).max()) for a, b in pairwise(stops))
        seconds += run.motion.seconds
        at = run.motion.start
    return seconds
