"""The controlled frame of an arm at one sample: where it is, and how joints move and push it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qrobot.arrays import Floats
from qrobot.model.arm import Arm
from qrobot.model.row_ops import row_of, store_row, times_inverse
from qrobot.model.vec3 import add, cross, dot
from qrobot.motion.force.joint_matching import inverse_of
from qrobot.realtime.jit import lean_kernel


@dataclass(frozen=True, eq=False)
class ControlledFrame:
    """The controlled frame at one sample.

    Attributes:
        frame: in the base. Shape (4, 4).
        jacobian: of the controlled frame in its own axes. Shape (6, n).
        inverse: of the Jacobian. Shape (n, 6).
    """

    frame: Floats
    jacobian: Floats
    inverse: Floats

    def wrench(self, tau: Floats) -> Floats:
        """The wrench in the controlled frame that joint torques `tau` (n,) exert. Shape (6,), N and N m."""
        wrench: Floats = self.inverse.T @ tau
        return wrench

    def wrench_bound(self, tau: Floats) -> Floats:
        """Bound of the wrench along each axis for independent torque errors of about `tau` (n,). Shape (6,)."""
        bound: Floats = np.sqrt(np.square(self.inverse).T @ np.square(tau))
        return bound


def controlled_frame(arm: Arm, q: Floats, tool: Floats) -> ControlledFrame:
    """The controlled frame at joint positions `q` (n,); `tool` (4, 4) is T6 in it."""
    J, frame = arm.jacobian(q), np.empty((4, 4))
    jacobian = np.empty_like(J)
    carry_to_frame(arm.forward(q), tool, J, frame, jacobian)
    return ControlledFrame(frame, jacobian, inverse_of(jacobian))


@lean_kernel
def carry_to_frame(t6: Floats, tool: Floats, J: Floats, frame: Floats, jacobian: Floats) -> None:
    """Fill in the controlled frame in the base, and the Jacobian `J` of T6 as that of the frame in its own axes.

    Column by column that is `model.differential.twist_to_child`. Shapes (4, 4) and (6, n).
    """
    for i in range(3):
        store_row(times_inverse(row_of(t6, i), tool), i, frame)
    arm = (frame[0, 3] - t6[0, 3], frame[1, 3] - t6[1, 3], frame[2, 3] - t6[2, 3])
    for j in range(J.shape[1]):
        turning = (J[3, j], J[4, j], J[5, j])
        moving = add((J[0, j], J[1, j], J[2, j]), cross(turning, arm))
        for i in range(3):
            axis = (frame[0, i], frame[1, i], frame[2, i])
            jacobian[i, j], jacobian[3 + i, j] = dot(axis, moving), dot(axis, turning)
