"""The straight way of one segment before it has its times: from corner to goal, and what it asks of the joints.

Everything is per whole way: with s from 0 at the corner to 1 at the goal and T the time it takes, joint velocities are
rates / T and joint accelerations bends / T^2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.model.branch import Branch
from qrobot.model.transform import inverse
from qrobot.motion.coordinates import JOINTS, Coordinates, DriveCoordinates, GoalRelativeJoints
from qrobot.motion.drive_transform import OrientationInterpolation, drive_parameters
from qrobot.motion.kinematics import Reach
from qrobot.motion.queued_motion import QueuedMotion
from qrobot.motion.request import MotionMode, MoveRequest, Way

PLACES: Final = 17  # where a Cartesian way is looked at


@dataclass(frozen=True, eq=False)
class GeometricPath:
    """A way in the coordinates (m,) of a chart.

    Attributes:
        chart: the coordinates.
        corner, target: its ends. Shape (m,).
        way: how far it is.
        rates, bends: first and second derivative of the joints by s at places along it. Shapes (k, n).
    """

    chart: Coordinates
    corner: Floats
    target: Floats
    way: Way
    rates: Floats
    bends: Floats

    def velocity(self, length_s: float) -> Floats:
        """Velocity on the way. Shape (m,)."""
        velocity: Floats = (self.target - self.corner) / length_s
        return velocity

    def leaving(self, length_s: float) -> Floats:
        """Joint velocity at its beginning. Shape (n,)."""
        velocity: Floats = self.rates[0] / length_s
        return velocity

    def arriving(self, length_s: float) -> Floats:
        """Joint velocity at its end. Shape (n,)."""
        velocity: Floats = self.rates[-1] / length_s
        return velocity


def joint_course(corner: Floats, target: Floats, tool: Floats | None = None) -> GeometricPath:
    """Straight in joint space. Shapes (n,); `tool` (6,) is what the controlled frame does."""
    return _linear(JOINTS, corner, target, tool)


def plan_geometric_path(errand: QueuedMotion, corner: Floats, reach: Reach | None) -> GeometricPath:
    """The way of `errand` from the joint positions `corner` (n,), with its goal where it was seen last.

    Raises:
        Unreachable, JointLimit, Singular: at the goal or on a Cartesian way.
        MotionError: a Cartesian way would have to change the configuration.
    """
    tool = _tool(errand, corner, reach)
    if errand.target is not None:
        return joint_course(corner, errand.target, tool)
    if errand.aim is None or reach is None or tool is None:
        raise MotionError("there is no goal")
    present, request = reach.branch(corner), errand.request
    if request.mode is MotionMode.CARTESIAN:
        _same_branch(request, present)
        return _straight(DriveCoordinates(errand.aim, reach, present, corner, request.turn), tool, corner)
    branch = present if request.branch is None else request.branch
    q = reach.inverse(errand.aim.newest.pose, branch, corner, singular=True)
    return _linear(GoalRelativeJoints(errand.aim, reach, branch, q), corner - q, np.zeros_like(q), tool)


def _same_branch(request: MoveRequest, present: Branch) -> None:
    if request.branch is not None and request.branch != present:
        change = f"from {present.letters!r} to {request.branch.letters!r}"
        raise MotionError(f"no straight line changes configuration {change}; use joint mode")


def _tool(errand: QueuedMotion, corner: Floats, reach: Reach | None) -> Floats | None:
    """DRIVE at the corner, shape (6,)."""
    if reach is None:
        return None
    if errand.aim is not None:
        turn = errand.request.turn if errand.request.mode is MotionMode.CARTESIAN else OrientationInterpolation.ONE_AXIS
        return drive_parameters(errand.aim.newest.drive_to(reach.forward(corner)), turn=turn)
    if errand.target is None:
        return None
    return drive_parameters(inverse(reach.forward(errand.target)) @ reach.forward(corner))


def _linear(chart: Coordinates, corner: Floats, target: Floats, tool: Floats | None) -> GeometricPath:
    distance = target - corner
    return GeometricPath(chart, corner, target, Way(distance, tool), distance[None, :], np.zeros((1, distance.size)))


def _straight(chart: DriveCoordinates, corner: Floats, q: Floats) -> GeometricPath:
    """Look at the joints all along the line from `corner` (6,), where they are `q` (n,)."""
    places = np.linspace(1.0, 0.0, PLACES)
    joints = np.empty((PLACES, q.size))
    for i, place in enumerate(places):
        joints[i] = q = chart.look(place * corner, q)
    step = 1.0 / (PLACES - 1)
    rates = np.array(np.gradient(joints, step, axis=0, edge_order=2))
    bends = np.array(np.gradient(rates, step, axis=0))
    return GeometricPath(chart, corner, np.zeros(6), Way(joints[-1] - joints[0], corner), rates, bends)
