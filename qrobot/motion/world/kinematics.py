"""The arm's kinematics as the generator needs it: every sample, and with a reason when there is no solution."""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np

from qrobot.arrays import Floats
from qrobot.model.arm import SINGULAR, Arm
from qrobot.model.branch import Branch
from qrobot.model.closed_form import CLOSED_FORMS
from qrobot.model.puma import InverseStatus
from qrobot.motion.world.numerical_kinematics import FEWEST_JOINTS, NumericalKinematics

NEAR_SINGULAR: Final = (
    0.08  # smallest singular value of the Jacobian (m, rad); about 0.3 in the middle of the workspace
)


class ArmKinematics(Protocol):
    """Kinematics of one arm. Joint positions have shape (n,), poses of T6 shape (4, 4)."""

    def forward(self, q: Floats) -> Floats:
        """T6 of joint positions."""

    def branch(self, q: Floats) -> Branch:
        """The configuration in which the arm stands."""

    def inverse(self, T: Floats, branch: Branch, near: Floats, singular: bool = False) -> Floats:
        """Joint positions of a configuration, by whole turns nearest to `near`.

        Args:
            T: pose of T6.
            branch: the configuration.
            near: where the arm is.
            singular: take a solution at a singular pose too; one where it ends, not where it passes.

        Raises:
            Unreachable, JointLimit, Singular: there is none, and why.
        """

    def near_singular(self, q: Floats) -> bool:
        """Some motion of T6 would need joints far faster than others."""


class ClosedFormKinematics:
    """An arm whose inverse has a closed form."""

    def __init__(self, arm: Arm) -> None:
        self._arm, self._form = arm, arm.closed_form

    def forward(self, q: Floats) -> Floats:
        """See `ArmKinematics.forward`."""
        return self._arm.forward(q)

    def branch(self, q: Floats) -> Branch:
        """See `ArmKinematics.branch`."""
        return Branch(self._form.branch(np.array(q), self._arm.params))

    def inverse(self, T: Floats, branch: Branch, near: Floats, singular: bool = False) -> Floats:
        """See `ArmKinematics.inverse`."""
        pose, around = np.array(T), np.array(near)  # the one type for which the kernel is compiled
        q = np.empty(self._arm.robot.n)
        status = self._form.inverse(pose, self._arm.params, int(branch), around, q)
        if status != InverseStatus.OK and not (singular and status in SINGULAR and self._inside(q)):
            raise self._arm.inverse_error(InverseStatus(status), T, branch, q)
        return q

    def near_singular(self, q: Floats) -> bool:
        """See `ArmKinematics.near_singular`."""
        return float(np.linalg.svd(self._arm.jacobian(q), compute_uv=False)[-1]) < NEAR_SINGULAR

    def _inside(self, q: Floats) -> bool:
        params = self._arm.params
        return bool(((params.q_min <= q) & (q <= params.q_max)).all())


def kinematics_of(arm: Arm) -> ArmKinematics | None:
    """The closed form for `arm`, or a numerical inverse; None for an arm that cannot take any pose."""
    if arm.robot.geometry.family in CLOSED_FORMS:
        return ClosedFormKinematics(arm)
    return NumericalKinematics(arm) if arm.robot.n >= FEWEST_JOINTS else None
