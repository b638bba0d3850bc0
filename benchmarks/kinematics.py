"""Benchmark K: the closed form of the PUMA on random poses inside its limits, beside EAIK's (`pip install eaik`).

Ours runs in a compiled loop, as in the generator's setpoint; EAIK, in C++, is called from Python as its users do. How
wrong the solutions are stands beside how long they take.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from benchmarks.rows import Goal, Row, against, row
from benchmarks.timing import Effort, interleaved
from qrobot.arrays import Floats
from qrobot.config import load_robot
from qrobot.model.arm import Arm
from qrobot.model.kinematics import forward
from qrobot.model.paul import T_PAUL_VAL
from qrobot.model.puma import OK, nearest_solution, puma_branch, puma_inverse, puma_inverse_all
from qrobot.realtime.jit import lean_kernel

POSES: Final = 10_000
SEED: Final = 1
TURNS: Final = 8  # as many turns for each round of other benchmarks: one takes milliseconds
BENT: Final = 1e-6  # |sin q5| above which joints 4 and 6 are told apart


@dataclass(frozen=True, eq=False)
class Poses:
    """Random poses of one arm. Shapes (k, 6) joints, (k, 4, 4) poses, (k,) branches."""

    arm: Arm
    q: Floats
    T: Floats
    branch: Any


@lean_kernel
def invert(T: Any, params: Any, branch: Any, near: Any, q: Any) -> int:
    """One inverse of each pose; the number of those that have no solution."""
    failed = 0
    for i in range(T.shape[0]):
        failed += puma_inverse(T[i], params, branch[i], near[i], q[i]) != OK
    return failed


@lean_kernel
def invert_all(T: Any, params: Any, near: Any, q: Any, status: Any) -> int:
    """All eight inverses of each pose within the limits, and the nearest; the number of poses without one."""
    failed = 0
    for i in range(T.shape[0]):
        puma_inverse_all(T[i], params, near[i], q, status)
        failed += nearest_solution(q, status, near[i]) < 0
    return failed


@lean_kernel
def go_forward(q: Any, params: Any, T: Any) -> None:
    """The pose of each row of joints."""
    for i in range(q.shape[0]):
        forward(q[i], params, T[i])


def rows(effort: Effort) -> Iterator[Row]:
    """The rows."""
    poses = random_poses(effort.times(POSES))
    yield from timed_rows(poses, effort)
    yield from error_rows(poses)


def random_poses(many: int) -> Poses:
    """Uniform in the joints' range; the first 10,000 are those of the definition."""
    arm = Arm(load_robot("puma560"))
    limits = arm.robot.limits
    q = np.random.default_rng(SEED).uniform(limits.q_min, limits.q_max, (many, arm.robot.n))
    T = np.empty((many, 4, 4))
    go_forward(q, arm.params, T)
    return Poses(arm, q, T, np.array([puma_branch(each, arm.params) for each in q]))


def timed_rows(poses: Poses, effort: Effort) -> Iterator[Row]:
    """Time for each pose."""
    params, many = poses.arm.params, len(poses.q)
    q, T, eight, status = (np.empty_like(poses.q), np.empty_like(poses.T), np.empty((8, 6)), np.empty(8, np.int64))
    work: dict[str, Callable[[], object]] = {
        "one": lambda: invert(poses.T, params, poses.branch, poses.q, q),
        "eight": lambda: invert_all(poses.T, params, poses.q, eight, status),
        "forward": lambda: go_forward(poses.q, params, T),
    }
    peer = eaik_puma(poses.arm)
    if peer is not None:
        in_paul = list(T_PAUL_VAL @ poses.T)
        work["EAIK"] = lambda: _each(peer.IK, in_paul)
        work["EAIK forward"] = lambda: _each(peer.fwdKin, poses.q)
    for each in work.values():
        each()  # compiles
    us = {name: 1e6 * best / many for name, best in interleaved(work, TURNS * effort.rounds).items()}
    yield row("inverse kinematics, one configuration", us["one"], "us", Goal(0.2))
    eight_of, forward_of = "inverse kinematics, all eight, limits, nearest", "forward kinematics"
    if peer is None:
        yield row(f"{eight_of} (EAIK is not installed: `make bench` installs it)", us["eight"], "us")
        yield row(forward_of, us["forward"], "us", Goal(0.1))
    else:
        yield against(eight_of, us["eight"], "us", "EAIK", us["EAIK"], Goal(0.25, "ratio"))
        yield against(forward_of, us["forward"], "us", "EAIK", us["EAIK forward"], Goal(0.1))


def _each(function: Callable[[Floats], object], arguments: Iterable[Floats]) -> None:
    for argument in arguments:
        function(argument)


def error_rows(poses: Poses) -> Iterator[Row]:
    """How far solutions are from the joints the poses were made of, and their poses from the poses."""
    params, q, back = poses.arm.params, np.empty_like(poses.q), np.empty_like(poses.T)
    failed = invert(poses.T, params, poses.branch, poses.q, q)
    go_forward(q, params, back)
    bent = np.abs(np.sin(poses.q[:, 4])) > BENT
    branches = np.array([puma_branch(each, params) for each in q])
    yield row("inverse kinematics, largest error of position", _largest((back - poses.T)[:, :3, 3]), "m", Goal(1e-12))
    yield row("inverse kinematics, largest error of a joint", _largest((q - poses.q)[bent]), "rad", Goal(1e-9))
    yield row("inverse kinematics, poses not solved", int(failed), "", Goal(0.0))
    yield row("inverse kinematics, solutions on another branch", int((branches != poses.branch).sum()), "", Goal(0.0))


def _largest(errors: Floats) -> float:
    return float(np.abs(errors).max())


def eaik_puma(arm: Arm) -> Any:
    """The arm in EAIK, in Paul's angles and base; None when EAIK is not installed.

    Paul's table: alpha 90, 0, -90, 90, -90, 0 deg, a2, a3, d3 and d4 (Paul, Shimano & Mayer 1981).
    """
    try:
        from eaik.IK_DH import DhRobot
    except ImportError:
        return None
    a, d = arm.params.chain.a, arm.params.chain.d
    alpha = np.radians([90.0, 0.0, -90.0, 90.0, -90.0, 0.0])
    in_a, in_d = np.array([0.0, a[2], -a[3], 0.0, 0.0, 0.0]), np.array([0.0, 0.0, d[1] + d[2], d[3], 0.0, 0.0])
    return DhRobot(alpha, in_a, in_d)
