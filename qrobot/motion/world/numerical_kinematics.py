"""Inverse kinematics of any serial arm with six joints or more, from where the arm stands.

On a way each sample follows from the one before. An end may be far from where the arm stands: when the steps from there
lead nowhere, they are taken from other positions, always the same ones. An arm without a closed form has no
configuration letters; the solution that is found first from where the arm stands counts.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import JointLimit, MotionError, Singular, Unreachable
from qrobot.model.arm import Arm
from qrobot.model.branch import Branch
from qrobot.model.numerical_inverse import approach, scratch_for
from qrobot.model.transform import is_transform
from qrobot.units import MM_PER_M

FEWEST_JOINTS: Final = 6  # of an arm that can take any pose
STARTS: Final = 300  # other positions to begin from: of 2,000 poses of 40 drawn arms 100 missed two, 300 none
NEAR: Final = 0.5  # rad or m: a solution within is the one that follows from where the arm is, whatever its range
NEAR_SINGULAR: Final = 0.05  # the same: some motion of T6 needs joints far faster than others [A]
_SINGULAR: Final = 1e-5  # smallest singular value of the Jacobian, rad and arm lengths
_SEED: Final = 560


class NumericalKinematics:
    """See `ArmKinematics`.

    Args:
        arm: with six joints or more.
    """

    def __init__(self, arm: Arm) -> None:
        self._arm, limits, geometry = arm, arm.robot.limits, arm.robot.geometry
        slides = np.where(arm.robot.prismatic, np.maximum(np.abs(limits.q_min), np.abs(limits.q_max)), 0.0)
        length = float((np.abs(geometry.a_m) + np.abs(geometry.d_m) + slides).sum())
        self._per_length = 1.0 / length
        self._starts = np.random.default_rng(_SEED).uniform(limits.q_min, limits.q_max, (STARTS, arm.robot.n))

    def forward(self, q: Floats) -> Floats:
        """See `ArmKinematics.forward`."""
        return self._arm.forward(q)

    def branch(self, _q: Floats) -> Branch:
        """The one that stands for all: there are no letters for the configurations of this arm."""
        return Branch.RUN

    def inverse(self, T: Floats, branch: Branch, near: Floats, singular: bool = False) -> Floats:
        """See `ArmKinematics.inverse`.

        Raises:
            MotionError: a configuration is asked for by its letters, or `T` is no rigid transform.
        """
        if branch != Branch.RUN:
            raise MotionError(
                f"configuration {Branch(branch).letters!r}: robot {self._arm.robot.name!r} has no letters for its "
                "configurations; leave them out, and the one nearest to where the arm stands is taken"
            )
        if not is_transform(T):  # every search would end at its first step, at a pose that is another
            raise MotionError("the pose is not a rigid transform: its rotation must be orthonormal and right-handed")
        q = self._solution(T, np.array(near), STARTS if singular else 0)
        if not singular and self._least_singular_value(q) < _SINGULAR:
            raise Singular(f"{_where(T)}: some motion of T6 would need joints without bound")
        return q

    def reaches(self, T: Floats) -> bool:
        """Whether some joint positions within their ranges have pose `T` (4, 4), as far as the searches tell."""
        return any(self._maybe_solved(T, start, bounded=True) is not None for start in self._starts)

    def near_singular(self, q: Floats) -> bool:
        """See `ArmKinematics.near_singular`."""
        return self._least_singular_value(q) < NEAR_SINGULAR

    def _solution(self, T: Floats, near: Floats, starts: int) -> Floats:
        """The solution that follows from `near` (n,), or one of the others within the ranges. Shape (n,)."""
        first = self._maybe_solved(T, near, bounded=False)
        if first is not None and float(np.abs(first - near).max()) < NEAR:
            self._require_inside(T, first)
            return first
        if first is not None and (turned := self._maybe_turned(first, near)) is not None:
            return turned
        for start in sorted(self._starts[:starts], key=lambda start: float(np.abs(start - near).max())):
            if (other := self._maybe_solved(T, start, bounded=True)) is not None:
                return other if (turned := self._maybe_turned(other, near)) is None else turned
        if first is not None:
            self._require_inside(T, first)
        raise Unreachable(
            f"{_where(T)}: out of the arm's reach{f', as far as {starts} searches tell' if starts else ''}"
        )

    def _maybe_turned(self, q: Floats, near: Floats) -> Floats | None:
        """The same by the whole turns within the ranges that are nearest to `near`; None when there are none."""
        turn = np.where(self._arm.robot.prismatic, np.inf, 2.0 * np.pi)
        fewest = np.ceil((self._arm.params.q_min - q) / turn)
        most = np.floor((self._arm.params.q_max - q) / turn)
        if (fewest > most).any():
            return None
        turns = np.clip(np.round((near - q) / turn), fewest, most)
        turned = q + np.where(self._arm.robot.prismatic, 0.0, 2.0 * np.pi * turns)
        return turned if self._inside(turned) else None

    def _maybe_solved(self, T: Floats, start: Floats, bounded: bool) -> Floats | None:
        """Joint positions that reach `T` by steps from `start` (n,), None when they lead nowhere. Shape (n,)."""
        q = np.array(start)
        solved = approach(np.array(T), self._arm.params, self._per_length, bounded, q, scratch_for(q.size))
        return q if solved else None

    def _inside(self, q: Floats) -> bool:
        params = self._arm.params
        return bool(((params.q_min <= q) & (q <= params.q_max)).all())

    def _require_inside(self, T: Floats, q: Floats) -> None:
        """Raises JointLimit for joint positions (n,) outside the ranges."""
        if not self._inside(q):
            raise JointLimit(f"{_where(T)}: {self._arm.limits_passed(q)}")

    def _least_singular_value(self, q: Floats) -> float:
        J = self._arm.jacobian(q)
        J[:3] *= self._per_length
        return float(np.linalg.svd(J, compute_uv=False)[-1])


def _where(T: Floats) -> str:
    return f"T6 at {np.round(MM_PER_M * T[:3, 3], 1).tolist()} mm"
