"""The geometric path of one segment, before it has its times: from via point to goal, and what it asks of the joints.

With s from 0 at the via point to 1 at the goal and T the time that takes, joint velocities are q'(s) / T and joint
accelerations q''(s) / T^2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import JointLimit, MotionError
from qrobot.model.branch import Branch
from qrobot.model.transform import inverse
from qrobot.motion.path.coordinates import JOINTS, Coordinates, DriveCoordinates, GoalRelativeJoints
from qrobot.motion.path.segment import Schedule, Segment
from qrobot.motion.planning.queued_motion import QueuedMotion
from qrobot.motion.request import Displacement, MotionMode, MoveRequest
from qrobot.motion.world.drive_transform import OrientationInterpolation, drive_parameters
from qrobot.motion.world.kinematics import ArmKinematics
from qrobot.motion.world.limits import MotionLimits

PROBES: Final = 17  # where a Cartesian way is looked at


@dataclass(frozen=True, eq=False)
class GeometricPath:
    """A straight line in motion coordinates (m,).

    Attributes:
        coordinates: the coordinates.
        via, target: its ends. Shape (m,).
        displacement: how far it is.
        dq_ds, ddq_dds: first and second derivative of the joints by s at places along it. Shapes (k, n).
        end_joints: joint positions at its end, as an arm has them that comes along it. Shape (n,).
    """

    coordinates: Coordinates
    via: Floats
    target: Floats
    displacement: Displacement
    dq_ds: Floats
    ddq_dds: Floats
    end_joints: Floats

    def velocity(self, length_s: float) -> Floats:
        """Velocity on the way. Shape (m,)."""
        velocity: Floats = (self.target - self.via) / length_s
        return velocity

    def leaving(self, length_s: float) -> Floats:
        """Joint velocity at its beginning. Shape (n,)."""
        velocity: Floats = self.dq_ds[0] / length_s
        return velocity

    def arriving(self, length_s: float) -> Floats:
        """Joint velocity at its end. Shape (n,)."""
        velocity: Floats = self.dq_ds[-1] / length_s
        return velocity


def segment_of(
    request: MoveRequest, geometry: GeometricPath, schedule: Schedule, begin: float, period_s: float
) -> Segment:
    """The segment that leaves its via point at path time `begin`."""
    seconds = schedule.length * period_s
    velocity, arriving = geometry.velocity(seconds), geometry.arriving(seconds)
    return Segment(
        request, geometry.coordinates, begin, geometry.via, geometry.target, schedule, velocity, arriving,
        geometry.end_joints,
    )  # fmt: skip


def joint_geometry(via: Floats, target: Floats, tool: Floats | None = None) -> GeometricPath:
    """Straight in joint space. Shapes (n,); `tool` (6,) is what the controlled frame does."""
    return _linear(JOINTS, via, target, tool, target)


def plan_geometric_path(
    queued: QueuedMotion,
    via: Floats,
    kinematics: ArmKinematics | None,
    limits: MotionLimits,
    arm: Floats | None = None,
) -> GeometricPath:
    """The way of `queued` from the joint positions `via` (n,), with its goal where it was seen last.

    An arm that enters it now is at `arm` (n,); None for at `via`.

    Raises:
        Unreachable, JointLimit, Singular: at the goal or on a Cartesian way.
        MotionError: a Cartesian way would have to change the configuration.
    """
    tool = _tool(queued, via, kinematics)
    if queued.target is not None:
        return joint_geometry(via, queued.target, tool)
    if queued.tracker is None or kinematics is None or tool is None:
        raise MotionError("there is no goal")
    present, request = kinematics.branch(via), queued.request
    if request.mode is MotionMode.CARTESIAN:
        _same_branch(request, present)
        near = via if arm is None else arm
        return _straight(DriveCoordinates(queued.tracker, kinematics, present, near, request.turn), tool, via, limits)
    branch = present if request.branch is None else request.branch
    q = kinematics.inverse(queued.tracker.newest.pose, branch, via, singular=True)
    return _linear(GoalRelativeJoints(queued.tracker, kinematics, branch, q), via - q, np.zeros_like(q), tool, q)


def _same_branch(request: MoveRequest, present: Branch) -> None:
    if request.branch is not None and request.branch != present:
        change = f"from {present.letters!r} to {request.branch.letters!r}"
        raise MotionError(f"no straight line changes configuration {change}; use joint mode")


def _tool(queued: QueuedMotion, via: Floats, kinematics: ArmKinematics | None) -> Floats | None:
    """DRIVE at the via point, shape (6,)."""
    if kinematics is None:
        return None
    if queued.tracker is not None:
        turn = queued.request.turn if queued.request.mode is MotionMode.CARTESIAN else OrientationInterpolation.ONE_AXIS
        return drive_parameters(queued.tracker.newest.drive_to(kinematics.forward(via)), turn=turn)
    if queued.target is None:
        return None
    return drive_parameters(inverse(kinematics.forward(queued.target)) @ kinematics.forward(via))


def _linear(
    coordinates: Coordinates, via: Floats, target: Floats, tool: Floats | None, end_joints: Floats
) -> GeometricPath:
    distance = target - via
    bends = np.zeros((1, distance.size))
    return GeometricPath(coordinates, via, target, Displacement(distance, tool), distance[None, :], bends, end_joints)


def _straight(coordinates: DriveCoordinates, via: Floats, q: Floats, limits: MotionLimits) -> GeometricPath:
    """Look at the joints all along the line from `via` (6,), where they are `q` (n,)."""
    places = np.linspace(1.0, 0.0, PROBES)
    joints = np.empty((PROBES, q.size))
    for i, place in enumerate(places):
        joints[i] = coordinates.solve_at(place * via, q)
        _check_turns(q, joints[i], limits)
        q = joints[i]
    step = 1.0 / (PROBES - 1)
    dq_ds = np.array(np.gradient(joints, step, axis=0, edge_order=2))
    ddq_dds = np.array(np.gradient(dq_ds, step, axis=0))
    displacement = Displacement(joints[-1] - joints[0], via)
    return GeometricPath(coordinates, via, np.zeros(6), displacement, dq_ds, ddq_dds, joints[-1])


def _check_turns(before: Floats, q: Floats, limits: MotionLimits) -> None:
    """Raise JointLimit when a joint has come to its other end: of the solutions the nearest is out of its range."""
    turned = np.where(limits.prismatic, 0.0, q - before)
    j = int(np.abs(turned).argmax())
    if abs(turned[j]) > np.pi:
        raise JointLimit(limits.leaving(j, q[j] - np.copysign(2.0 * np.pi, turned[j])))
