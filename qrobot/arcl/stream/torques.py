"""Joint torques of the rigid body, computed afterwards from the joint setpoints of a stream (section 4)."""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arcl.kinematics import kinematics
from qrobot.arcl.stream.layout import RecordKind
from qrobot.arcl.stream.reader import Stream
from qrobot.arcl.stream.tables import TrajectoryTable
from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import LogError
from qrobot.model.dynamics import dynamics_params, dynamics_work, inverse_dynamics

_FEWEST: Final = 3  # setpoints that have velocities and accelerations


def torque_table(stream: Stream, robot: Robot) -> TrajectoryTable:
    """Time, s, and the torques that the motors of an arm supply which follows the setpoints exactly, N m (N).

    Gravity, inertia and rotors of the robot file; friction and whatever the arm touches are left out. Velocities and
    accelerations are central differences.

    Raises:
        LogError: the stream is another robot's, or has too few setpoints.
    """
    if (stream.start.robot, stream.start.n) != (robot.name, robot.n):
        raise LogError(f"the stream is of {stream.start.robot!r} with {stream.start.n} joints, not of {robot.name!r}")
    times, rows = stream.table(RecordKind.JOINTS, robot.n)
    if len(times) < _FEWEST:
        raise LogError(f"{len(times)} joint setpoints are too few for torques; {_FEWEST} are needed")
    torques = _torques(rows + kinematics(robot).zero, times, robot)
    names = [f"tau{i + 1}_{'N' if slides else 'Nm'}" for i, slides in enumerate(robot.prismatic)]
    return {"t_s": times} | dict(zip(names, torques.T.copy(), strict=True))


def _torques(q: Floats, times: Floats, robot: Robot) -> Floats:
    """Torques at joint positions of the robot file. Shapes (rows, n)."""
    v = np.array(np.gradient(q, times, axis=0))
    a = np.array(np.gradient(v, times, axis=0))
    params, work, tau = dynamics_params(robot), dynamics_work(robot.n), np.empty_like(q)
    for k in range(len(q)):
        inverse_dynamics(q[k], v[k], a[k], params, work, tau[k])
    return tau
