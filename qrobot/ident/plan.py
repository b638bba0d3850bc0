"""Motions that identify the arm: swings through chosen poses, and sweeps of each joint at several speeds.

A swing goes through its centre at constant speed, forwards and back. Poses are chosen for information: of many random
ones that set for which the determinant of the information matrix of the base parameters is largest (D-optimal), by
adding one at a time and then exchanging until nothing improves (Fedorov 1972). Each motor's torque counts by its
Coulomb friction, which is about what its scatter is proportional to.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice, pairwise
from typing import Any, Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import IdentificationError
from qrobot.fences.fence_set import FenceSet
from qrobot.ident.base import BaseParameters
from qrobot.ident.clearance import Clearance
from qrobot.ident.regressor import Regressor, known_parameters

POSES: Final = 24
SWING_SPEED: Final = 0.1  # of each joint's greatest speed, through poses
SWEEP_SPEEDS: Final = (0.2, 0.4, 0.7)
SLOW_SPEEDS: Final = (0.01, 0.02, 0.04)  # where friction falls with speed
TRAVEL_SPEED: Final = 0.4
PASS_S: Final = 1.0  # at constant speed
READY: Final = "ready"
TORQUE_SHARE: Final = 0.6  # of the guard's limit: what weight and friction may take, by the robot file
RANGE_MARGIN: Final = 0.05  # of a joint's range, kept at either end
_PEAK: Final = 1.6  # peak over mean acceleration of a transition, with a little to spare (Paul 1981: 1.5)
_SHORTEST_TURN_S: Final = 0.15
_CANDIDATES: Final = 250
_EXCHANGES: Final = 20


@dataclass(frozen=True, eq=False)
class Swing:
    """Motion from `centre - half` to `centre + half` and back, each in `seconds` and at constant speed.

    Attributes:
        name: for people.
        centre, half: rad (m). Shape (n,).
        turn_s: half the length of the transition at each end.
        by_ready: the way there goes by the pose `ready`.
    """

    name: str
    centre: Floats
    half: Floats
    seconds: float
    turn_s: float
    by_ready: bool = False

    @property
    def low(self) -> Floats:
        """Position at its begin and its end. Shape (n,)."""
        return self.centre - self.half

    @property
    def high(self) -> Floats:
        """Position at which it turns. Shape (n,)."""
        return self.centre + self.half


@dataclass(frozen=True, eq=False)
class ExcitationPlan:
    """Swings in the order in which they are made.

    Attributes:
        robot: name.
        swings: through poses, then sweeps.
        condition: of the base parameters at the poses, columns scaled to length 1; 1 where there are none.
        seconds: an estimate of the whole.
    """

    robot: str
    swings: tuple[Swing, ...]
    condition: float
    seconds: float

    @property
    def moves(self) -> tuple[Swing, ...]:
        """Moves in the order in which they are made."""
        return self.swings

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; positions in rad (m)."""
        swings = [
            {"name": s.name, "centre": s.centre.tolist(), "half": s.half.tolist(), "seconds": s.seconds}
            for s in self.swings
        ]
        return {"robot": self.robot, "seconds": self.seconds, "condition": self.condition, "swings": swings}


def make_plan(
    robot: Robot,
    regressor: Regressor,
    base: BaseParameters,
    poses: int = POSES,
    seed: int = 0,
    slow: bool = False,
    fences: FenceSet | None = None,
) -> ExcitationPlan:
    """Choose poses and speeds for a robot; the same seed gives the same plan.

    Args:
        robot: its file.
        regressor: of its gravity.
        base: parameters of the regressor.
        poses: to swing through.
        seed: of the random poses to choose from.
        slow: sweep each joint slowly too, for Stribeck's friction.
        fences: that the arm keeps off, beyond their margins.

    Raises:
        IdentificationError: `ready` is not clear, too few poses are, or fewer are asked for than tell everything.
    """
    clearance = Clearance(robot, fences)
    clearance.check_ready(robot.poses[READY])
    half = np.minimum(0.5 * SWING_SPEED * robot.limits.v_max * _seconds(robot, SWING_SPEED), _widest(robot))
    candidates = _candidates(robot, regressor, clearance, half, seed)
    sought = len(base.leading)
    if poses * robot.n < sought or len(candidates) < poses:
        raise IdentificationError(f"{poses} of {len(candidates)} clear poses cannot tell {sought} parameters")
    columns = motor_columns(robot, base.columns(regressor(candidates)))
    chosen = choose_informative(columns, poses) if sought else list(range(poses))  # for friction alone
    through = [_swing(robot, f"pose {i + 1}", q, half, SWING_SPEED) for i, q in enumerate(candidates[chosen])]
    centres = [robot.poses[READY], *candidates]
    sweeps = list(_sweeps(robot, clearance, centres, (*SLOW_SPEEDS, *SWEEP_SPEEDS) if slow else SWEEP_SPEEDS))
    swings = tuple(_in_order(robot, clearance, through, sweeps))
    seconds = _estimate(robot, swings)
    return ExcitationPlan(robot.name, swings, _condition(np.concatenate(columns[chosen])), seconds)


def _condition(columns: Floats) -> float:
    """Condition of columns (rows, b), scaled to length 1; 1 where there are none."""
    if not columns.shape[1]:
        return 1.0
    return float(np.linalg.cond(columns / np.linalg.norm(columns, axis=0)))


def choose_informative(columns: Floats, count: int) -> list[int]:
    """The `count` poses whose rows together have the largest determinant of information; columns: (m, rows, b)."""
    each = np.einsum("mri,mrj->mij", columns, columns)
    total = 1e-6 * np.trace(each.mean(axis=0)) * np.eye(each.shape[-1])  # until there are enough to invert
    chosen: list[int] = []
    for _ in range(count):
        chosen.append(_best(total + each))
        total = total + each[chosen[-1]]
    for _ in range(_EXCHANGES):
        before = list(chosen)
        for place in range(len(chosen)):
            total = total - each[chosen[place]]
            chosen[place] = _best(total + each)
            total = total + each[chosen[place]]
        if chosen == before:
            break
    return sorted(chosen)


def _best(totals: Floats) -> int:
    return int(np.argmax(np.linalg.slogdet(totals)[1]))


def motor_columns(robot: Robot, columns: Floats) -> Floats:
    """Columns of the motors' torques from those of the joints' (..., n, b), over each motor's Coulomb friction."""
    friction = robot.friction[robot.control.friction_preset]
    scatter = np.maximum(friction.coulomb_pos + friction.coulomb_neg, 1e-3)
    to_motor = np.linalg.inv(robot.transmission.coupling.T)
    return np.asarray((to_motor / scatter[:, None]) @ columns)


def _candidates(robot: Robot, regressor: Regressor, clearance: Clearance, half: Floats, seed: int) -> Floats:
    """Random poses whose swing is within the limits, clear, not too heavy, and has a clear way from `ready`."""
    random, (low, high) = np.random.default_rng(seed), _range(robot, half)
    draws = random.uniform(low, high, (_CANDIDATES * 4, robot.n))
    friction = robot.friction[robot.control.friction_preset]
    weight = np.abs(regressor(draws) @ known_parameters(robot, regressor))
    load = weight + np.maximum(friction.coulomb_pos, friction.coulomb_neg)
    light = draws[(load <= TORQUE_SHARE * robot.guard.tau_max).all(axis=1)]
    ready = robot.poses[READY]
    clear = (q for q in light if clearance.of_path(np.stack([ready, q - half, q + half])))
    return np.array(list(islice(clear, _CANDIDATES))).reshape(-1, robot.n)


def _range(robot: Robot, half: Floats) -> tuple[Floats, Floats]:
    """Lowest and highest centre of a swing. Shapes (n,)."""
    margin = RANGE_MARGIN * (robot.limits.q_max - robot.limits.q_min) + half
    return robot.limits.q_min + margin, robot.limits.q_max - margin


def _widest(robot: Robot) -> Floats:
    """Half of the widest swing, which leaves its centre a tenth of the range. Shape (n,)."""
    return (0.5 - 2.0 * RANGE_MARGIN) * (robot.limits.q_max - robot.limits.q_min)


def _turn(robot: Robot, share: float) -> float:
    """Half the length of a transition that turns every joint round at a share of its greatest speed."""
    slowest = float((_PEAK * share * robot.limits.v_max / robot.limits.a_max).max())
    return max(_SHORTEST_TURN_S, slowest)


def _seconds(robot: Robot, share: float) -> float:
    return PASS_S + 2.0 * _turn(robot, share)


def _swing(robot: Robot, name: str, centre: Floats, half: Floats, share: float) -> Swing:
    return Swing(name, centre, half, _seconds(robot, share), _turn(robot, share))


def _sweeps(robot: Robot, clearance: Clearance, centres: list[Floats], speeds: tuple[float, ...]) -> Iterator[Swing]:
    """Each joint alone, at several speeds, around the first of the centres where it is clear, and the way from `ready`.

    Raises:
        IdentificationError: there is none.
    """
    ready = robot.poses[READY]
    for joint, name in enumerate(robot.joint_names):
        for share in speeds:
            half = np.zeros(robot.n)
            wanted = 0.5 * share * robot.limits.v_max[joint] * _seconds(robot, share)
            half[joint] = min(wanted, _widest(robot)[joint])
            inside = (np.clip(centre, *_range(robot, half)) for centre in centres)
            clear = (centre for centre in inside if clearance.of_path(np.stack([ready, centre - half, centre + half])))
            if (centre := next(clear, None)) is None:
                raise IdentificationError(
                    f"sweeping {name} comes too near to the floor, a fence or the arm itself wherever it is tried"
                )
            yield _swing(robot, f"{name} at {100 * share:.0f} %", centre, half, share)


def _in_order(robot: Robot, clearance: Clearance, through: list[Swing], sweeps: list[Swing]) -> Iterator[Swing]:
    """Poses, the nearest next; then the sweeps. By way of `ready`, clear for all, where the straight way is not."""
    at = robot.poses[READY]
    while through or sweeps:
        pool = through or sweeps[:1]
        nearest = min(pool, key=lambda swing: _distance(robot, at, swing.low))
        (through or sweeps).remove(nearest)
        yield _routed(nearest, clear=clearance.of_way(at, nearest.low))
        at = nearest.low


def _routed(swing: Swing, clear: bool) -> Swing:
    return Swing(swing.name, swing.centre, swing.half, swing.seconds, swing.turn_s, by_ready=not clear)


def _distance(robot: Robot, begin: Floats, end: Floats) -> float:
    """Seconds of the travel between two positions."""
    return float((np.abs(end - begin) / (TRAVEL_SPEED * robot.limits.v_max)).max())


def _estimate(robot: Robot, swings: tuple[Swing, ...]) -> float:
    ready = robot.poses[READY]
    at, total = ready, 0.0
    for swing in swings:
        stops = [at, ready, swing.low] if swing.by_ready else [at, swing.low]
        total += sum(_distance(robot, a, b) for a, b in pairwise(stops))
        total += 2.0 * swing.seconds + 4.0 * swing.turn_s
        at = swing.low
    return total
