"""Kinematics of a robot for everyday use: arrays in, arrays out, errors raised. The kernels are one layer below."""

from __future__ import annotations

import numpy as np

from qrobot.arrays import Floats
from qrobot.config.robot import Robot
from qrobot.errors import JointLimit, MotionError, Singular, Unreachable
from qrobot.model.branch import ALL_BRANCHES, Branch
from qrobot.model.chain import link_turn, to_parent
from qrobot.model.closed_form import CLOSED_FORMS, ClosedForm
from qrobot.model.kinematics import forward, jacobian, kinematics_params
from qrobot.model.puma import InverseStatus, nearest_solution
from qrobot.model.transform import is_transform, transform

SINGULAR = {
    InverseStatus.SHOULDER_SINGULAR: "the wrist is on the shoulder's cylinder, where left and right are one",
    InverseStatus.ELBOW_SINGULAR: "the arm is stretched or folded, where up and down are one",
    InverseStatus.WRIST_SINGULAR: "joints 4 and 6 are in line, so only their sum is determined",
}


def _own(array: Floats) -> Floats:
    """A writable float64 copy: the one type for which the kernels are compiled, whatever a caller has."""
    return np.array(array, dtype=np.float64)


class Arm:
    """Kinematics of one robot. Poses are those of its last link frame (a PUMA's wrist centre) in its base frame."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.params = kinematics_params(robot)
        self.T_last_flange = transform(translation=[0.0, 0.0, robot.geometry.flange_m])

    def forward(self, q: Floats) -> Floats:
        """Pose of the last frame at joint positions `q` (n,). Shape (4, 4)."""
        T = np.empty((4, 4))
        forward(self._joints(q), self.params, T)
        return T

    def flange(self, q: Floats) -> Floats:
        """Pose of the mounting flange at joint positions `q` (n,). Shape (4, 4)."""
        return self.forward(q) @ self.T_last_flange

    def jacobian(self, q: Floats) -> Floats:
        """`[v; w] = J qd`: velocity and angular velocity of the last frame in base axes. Shape (6, n)."""
        J = np.empty((6, self.robot.n))
        jacobian(self._joints(q), self.params, J)
        return J

    def link_jacobian(self, q: Floats, link: int) -> Floats:
        """The same motion in the axes of frame `link` (1 to n). Shape (6, n).

        In the axes of link 4 of an arm with a spherical wrist most of it is zero or constant: the form in which RCCL
        computed it (Hayward & Paul 1986, after Renaud).
        """
        if not 1 <= link <= self.robot.n:
            raise MotionError(f"{self.robot.name} has links 1 to {self.robot.n}, none of number {link}")
        R = self._orientation(self._joints(q), link)
        J = self.jacobian(q)
        return np.vstack((R.T @ J[:3], R.T @ J[3:]))

    def _orientation(self, q: Floats, link: int) -> Floats:
        """Axes of frame `link` in the base. Shape (3, 3)."""
        R = np.eye(3)
        for i in range(link):
            turn = link_turn(q, self.params.chain, i)
            R = R @ np.array([to_parent(turn, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]).T
        return R

    def branch(self, q: Floats) -> Branch:
        """The branch on which the arm stands at `q` (n,).

        Raises:
            MotionError: branches are only defined for arms with a closed-form inverse.
        """
        return Branch(self.closed_form.branch(self._joints(q), self.params))

    def inverse(self, T: Floats, branch: Branch, near: Floats) -> Floats:
        """Joint positions of `branch` that reach pose `T` (4, 4), by whole turns nearest to `near` (n,). Shape (n,).

        Raises:
            Unreachable: the wrist cannot get there.
            Singular: two branches meet at the pose, or the wrist is straight.
            JointLimit: the branch reaches the pose only outside a joint's range.
            MotionError: `T` is no rigid transform, or the robot has no closed-form inverse.
        """
        self._need_pose(T)
        q = np.empty(self.robot.n)
        status = self.closed_form.inverse(_own(T), self.params, int(branch), self._joints(near), q)
        self._judge(InverseStatus(status), T, branch, q)
        return q

    def inverses(self, T: Floats, near: Floats) -> dict[Branch, Floats]:
        """The solutions of all branches that reach pose `T` (4, 4) within the joint ranges; empty if none does.

        Raises:
            MotionError: `T` is no rigid transform, or the robot has no closed-form inverse.
        """
        q, status = self._solve_all(T, near)
        return {branch: q[branch] for branch in ALL_BRANCHES if status[branch] == InverseStatus.OK}

    def nearest(self, T: Floats, near: Floats) -> Floats:
        """The solution of any branch whose largest joint step from `near` (n,) is smallest. Shape (n,).

        Raises:
            Unreachable, Singular, JointLimit: why the branch on which `near` stands has no solution, if none has one.
            MotionError: `T` is no rigid transform, or the robot has no closed-form inverse.
        """
        q, status = self._solve_all(T, near)
        best = nearest_solution(q, status, self._joints(near))
        if best < 0:
            best = int(self.branch(near))
            self._judge(InverseStatus(status[best]), T, Branch(best), q[best])
        solution: Floats = q[best]
        return solution

    def _solve_all(self, T: Floats, near: Floats) -> tuple[Floats, np.ndarray[tuple[int], np.dtype[np.int64]]]:
        self._need_pose(T)
        q, status = np.empty((8, self.robot.n)), np.empty(8, dtype=np.int64)
        self.closed_form.inverse_all(_own(T), self.params, self._joints(near), q, status)
        return q, status

    def _joints(self, q: Floats) -> Floats:
        """`q` for a kernel.

        Raises:
            MotionError: it is not n numbers.
        """
        if np.shape(q) != (self.robot.n,):
            raise MotionError(f"robot {self.robot.name!r} has {self.robot.n} joints, not {np.shape(q)}")
        return _own(q)

    @property
    def closed_form(self) -> ClosedForm:
        """Kernels of the inverse. Raises MotionError when there are none for this family of arms."""
        family = self.robot.geometry.family
        if family not in CLOSED_FORMS:
            raise MotionError(f"robot {self.robot.name!r} has no closed-form inverse: its family is {family!r}")
        return CLOSED_FORMS[family]

    def _need_pose(self, T: Floats) -> None:
        if not is_transform(T):
            raise MotionError("the pose is not a rigid transform: its rotation must be orthonormal and right-handed")

    def _judge(self, status: InverseStatus, T: Floats, branch: Branch, q: Floats) -> None:
        """Raise what `status` stands for."""
        if status != InverseStatus.OK:
            raise self.inverse_error(status, T, branch, q)

    def inverse_error(self, status: InverseStatus, T: Floats, branch: Branch, q: Floats) -> MotionError:
        """Sentence for people about `status` of an inverse at pose `T` (4, 4), which filled in `q` (n,)."""
        where = f"configuration {branch.letters!r}, T6 at {np.round(1e3 * T[:3, 3], 1).tolist()} mm"
        if status == InverseStatus.UNREACHABLE:
            return Unreachable(f"{where}: out of the arm's reach")
        if status == InverseStatus.JOINT_LIMIT:
            return JointLimit(f"{where}: {self.limits_passed(q)}")
        return Singular(f"{where}: {SINGULAR[status]}")

    def limits_passed(self, q: Floats) -> str:
        """Joints that would be out of their range at `q` (n,), in words; empty when none."""
        low, high = self.robot.limits.q_min, self.robot.limits.q_max
        return ", ".join(
            f"{self.robot.joint_names[j]} would be at {self._told(j, q[j], 2)} of "
            f"{self._told(j, low[j], 0)}..{self._told(j, high[j], 0)} {'mm' if self.robot.prismatic[j] else 'deg'}"
            for j in range(self.robot.n)
            if not low[j] <= q[j] <= high[j]
        )

    def _told(self, joint: int, value: float, digits: int) -> str:
        """A joint position for people: degrees, or millimetres on a sliding joint."""
        return f"{1e3 * value if self.robot.prismatic[joint] else np.degrees(value):.{digits}f}"
