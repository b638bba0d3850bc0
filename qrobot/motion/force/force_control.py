"""Force control of one arm: joints that give way, the torques they get, and the forces that end a motion.

At each sample, with C the controlled frame, J its Jacobian in its own axes and S the joints matched with its compliant
axes (Hayward & Paul 1986, section 2.4):

    torque_S = (J' f)_S + G_S - D (v - v_planned)_S        f: the wrench the program wants exerted

G is left to the servo where it carries the arm anyhow, and friction always: the servo sees at once how fast a joint
is, and adds the friction of one that stands in the direction of its torque (`model.stiction_compensation`). A joint
that stands although its plan moves it is given a little more, which tells that direction. The damping D keeps a joint
that meets nothing from running away.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import MotionError, Singular
from qrobot.model.arm import Arm
from qrobot.motion.event import Termination
from qrobot.motion.force.controlled_frame import ControlledFrame, controlled_frame
from qrobot.motion.force.external_torque import ArmSample, Exerted, ExternalTorque
from qrobot.motion.force.joint_matching import KEPT_FITNESS, JointIndices, drift_step, fitness, match
from qrobot.motion.generator import Generator
from qrobot.motion.request import MoveRequest
from qrobot.motion.world.compliance import N_AXES, Compliance
from qrobot.motion.world.equation import Goal
from qrobot.motion.world.kinematics import ArmKinematics

LEAD: Final = 2.5  # samples from a state to the setpoint that answers it: half in the queue, two in the interpolator
FADE_S: Final = 0.4  # in which a joint's torque goes over from what its servo gave to what it shall be [A]
SETTLE_S: Final = 1.0  # in which it goes to where that torque leaves it [A]
USABLE: Final = 0.9  # share of a torque limit [A]
_DAMPING: Final = 0.25  # of M0 per sample, so that a joint slows down over several of them and cannot oscillate [A]
_SHARE: Final = 0.3  # of the drift found that one sample takes over: the other joints have to follow it smoothly [A]


@dataclass(frozen=True, eq=False)
class JointCommand:
    """Command of the joints for the servo.

    Attributes:
        setpoints: position, or torque on the joints that give way. Shape (n,), joint units.
        torque: which joints those are. Shape (n,).
    """

    setpoints: tuple[float, ...]
    torque: tuple[bool, ...]


class ForceControl:
    """Force control of one arm beside its trajectory generator: `observe` before each sample of it, `command` after.

    Args:
        robot: the arm.
        period_s: sample period.
        kinematics: its inverse kinematics, None when they are not known.

    Attributes:
        standing: for `Generator.update`: where the joints that give way are, NaN on the others. Shape (n,), or None.
        joints: those that give way.
    """

    def __init__(self, robot: Robot, period_s: float, kinematics: ArmKinematics | None) -> None:
        self._arm, self._kinematics = Arm(robot), kinematics
        self._period_s = period_s
        self._external = ExternalTorque(robot, period_s)
        self._uncarried = ~robot.control.gravity_joints
        self._damping = _DAMPING / period_s * robot.control.inertia
        self._tau_max = USABLE * robot.guard.tau_max
        self.standing: Floats | None = None
        self.joints: JointIndices = ()
        self._compliance: Compliance | None = None
        self._frame: ControlledFrame | None = None
        self._newest_frame: tuple[int, Goal | None, ControlledFrame] | None = (
            None  # the newest contact, and what it was asked for
        )
        self._asked: Floats | None = None  # setpoints of the sample before
        self._stood: Floats | None = None  # where the arm was then, foreseen to the time of those setpoints
        self._exerted = np.zeros(robot.n)  # by a joint when it began to give way
        self._first = np.zeros(robot.n)  # setpoint that goes on with that
        self._since = np.zeros(robot.n)  # samples since then
        self._carried = np.zeros(N_AXES)  # what the newest sample added to the drift
        self._failed = Termination.NONE

    # ------------------------------------------------------------------------------------------------ at any time

    @property
    def exerted(self) -> Exerted | None:
        """Torques on the world, as estimated at the newest sample; None before the first."""
        return self._external.estimate()

    def carry(self, mass: float, centre: Floats, inertia: Floats) -> None:
        """Reckon with a payload; see `ExternalTorque.carry`."""
        self._external.carry(mass, centre, inertia)

    def check(self, goal: Goal, near: Floats, tick: int) -> None:
        """Judge a motion that complies: joints must match and suffice where it ends, as far as that is known now.

        Raises:
            Unreachable, JointLimit, Singular: at the goal.
            MotionError: the forces are too large for the arm there, or no inverse kinematics are known.
        """
        compliance = goal.compliance
        if compliance is None:
            return
        if self._kinematics is None:
            raise MotionError(f"{goal.name}: this arm has no inverse kinematics, so it cannot comply")
        q = self._kinematics.inverse(goal.pose(tick), self._kinematics.branch(near), near, singular=True)
        there = controlled_frame(self._arm, q, goal.tool(tick))
        try:
            joints = match(there.jacobian, there.inverse, compliance.axes)
        except Singular as error:
            raise Singular(f"{goal.name}: cannot comply along {compliance.names}: {error}") from error
        self._check_torques(goal.name, there.jacobian.T @ compliance.wrench + self._external.gravity(q), joints)

    def _check_torques(self, name: str, tau: Floats, joints: JointIndices) -> None:
        for j in joints:
            if abs(tau[j]) > self._tau_max[j]:
                what = f"joint {j + 1} ({self._arm.robot.joint_names[j]}) would need {abs(tau[j]):.1f}"
                raise MotionError(f"{name}: {what} N m for these forces, {self._tau_max[j]:.1f} allowed; ask for less")

    # ---------------------------------------------------------------------------------------------- once per sample

    def observe(self, sample: ArmSample, generator: Generator, tick: int) -> None:
        """Take in what the robot says, carry COMPLY along, and end the motion where a limit is passed."""
        self._external.observe(sample, tick)
        self._carried = np.zeros(N_AXES)
        if self._compliance is not None and generator.goal is not None:
            self._carry_along(self._compliance)
        if self._failed:
            generator.abort(self._failed)
        else:
            self._end_at_limits(sample, generator, tick)
        self._failed = Termination.NONE
        self._stood = sample.q + LEAD * self._period_s * sample.v
        self.standing = None
        if self.joints:
            self.standing = np.full(sample.q.size, np.nan)
            self.standing[list(self.joints)] = self._stood[list(self.joints)]

    def command(self, q: Floats, sample: ArmSample, generator: Generator, tick: int) -> JointCommand:
        """Command for the servo when the generator wants the joints at `q` (n,)."""
        goal = generator.goal
        compliance = None if goal is None else goal.compliance
        planned = np.zeros(q.size) if self._asked is None else (q - self._asked) / self._period_s
        self._asked = q
        if goal is None or compliance is None:
            self._let_go()
            return JointCommand(tuple(q.tolist()), (False,) * q.size)
        self._frame = self._frame_at(sample, goal, tick)
        planned -= self._frame.inverse @ self._carried / self._period_s  # to drift is not the plan
        if compliance is not self._compliance:
            compliance.drift.keep(self._kept_axes(compliance))
            self._compliance = compliance
        self._take_joints(compliance, self._frame, sample.v)
        setpoints = q.copy()
        S = list(self.joints)
        setpoints[S] = self._torque(compliance, self._frame, sample, planned)[S]
        return JointCommand(tuple(setpoints.tolist()), tuple(j in self.joints for j in range(q.size)))

    # ------------------------------------------------------------------------------------------------------ inside

    def _frame_at(self, sample: ArmSample, goal: Goal | None, tick: int) -> ControlledFrame:
        """The controlled frame of `goal`, T6 without one; the limits and the torques of a sample ask for the same."""
        if self._newest_frame is None or self._newest_frame[:2] != (tick, goal):
            tool = np.eye(4) if goal is None else goal.tool(tick)
            self._newest_frame = tick, goal, controlled_frame(self._arm, sample.q, tool)
        return self._newest_frame[2]

    def _carry_along(self, compliance: Compliance) -> None:
        """Update COMPLY from the errors of the joints that give way."""
        if self._frame is None or self._asked is None or self._stood is None or not self.joints:
            return
        if self._failed or len(self.joints) != len(compliance.axes):
            return  # none were found for these axes, and the motion ends
        S = list(self.joints)
        error = self._stood[S] - self._asked[S]
        step = drift_step(self._frame.inverse, compliance.axes, self.joints, error)
        self._carried[list(compliance.axes)] = _SHARE * step
        compliance.drift.values += self._carried

    def _kept_axes(self, compliance: Compliance) -> tuple[int, ...]:
        before = () if self._compliance is None else self._compliance.axes
        return tuple(axis for axis in compliance.axes if axis in before)

    def _let_go(self) -> None:
        if self._compliance is not None:
            self._compliance.drift.keep(())
        self._compliance, self._frame, self.joints = None, None, ()

    def _take_joints(self, compliance: Compliance, there: ControlledFrame, v: Floats) -> None:
        """Keep the joints that give way while they serve, else match anew."""
        J, G, axes = there.jacobian, there.inverse, compliance.axes
        if len(self.joints) == len(axes) and fitness(J, G, axes, self.joints) >= KEPT_FITNESS:
            return
        try:
            joints = match(J, G, axes)
        except Singular:
            self._failed = Termination.SINGULAR
            return
        exerted = np.zeros(v.size) if self.exerted is None else self.exerted.torque
        taken = sorted(set(joints) - set(self.joints))
        self._exerted[taken] = exerted[taken]
        self._first[taken] = self._external.friction.setpoint(exerted, v)[taken]
        self._since[taken] = 0
        self.joints = joints

    def _torque(self, compliance: Compliance, there: ControlledFrame, sample: ArmSample, planned: Floats) -> Floats:
        """Torque setpoints, of which those of the joints that give way count. Shape (n,)."""
        gravity, elapsed_s = self._external.gravity(sample.q), self._since * self._period_s
        friction = self._external.friction
        tau = self._settling(there.jacobian.T @ compliance.wrench, elapsed_s)
        tau += friction.hint(sample.v, planned) - self._damping * (sample.v - planned)
        share = np.clip(elapsed_s / FADE_S, 0.0, 1.0)
        self._since += 1
        tau = share * tau + (1.0 - share) * self._first
        room = np.maximum(0.0, self._tau_max - np.abs(gravity) - np.abs(friction.added(tau)))
        return np.clip(tau, -room, room) + np.where(self._uncarried, gravity, 0.0)

    def _settling(self, wanted: Floats, elapsed_s: Floats) -> Floats:
        """Setpoints for torques `wanted` on the world: a joint that pressed harder first is let back. Shapes (n,).

        What friction holds is not let go by a smaller torque in the same direction. So the torque it exerted when it
        began to give way, which counts less and less, is compared with what is wanted: friction is asked for in the
        direction of the difference.
        """
        left = np.clip(1.0 - elapsed_s / SETTLE_S, 0.0, 1.0)
        friction, standing = self._external.friction, np.zeros(wanted.size)
        settled = friction.setpoint(wanted + friction.added(wanted - left * self._exerted), standing)
        return np.where((left > 0.0) & (wanted != 0.0), settled, wanted)

    def _end_at_limits(self, sample: ArmSample, generator: Generator, tick: int) -> None:
        """End what passes its limit: the present motion, or the one before until it has ended."""
        if code := self._limit_passed(sample, generator.passing, tick):
            generator.end_passing(code)
        if code := self._limit_passed(sample, generator.serving, tick):
            generator.skip(code)

    def _limit_passed(self, sample: ArmSample, request: MoveRequest | None, tick: int) -> Termination:
        if request is None or request.limits is None or (exerted := self.exerted) is None:
            return Termination.NONE
        there = self._frame_at(sample, request.target if isinstance(request.target, Goal) else None, tick)
        sure = np.abs(there.wrench(exerted.torque)) - there.wrench_bound(exerted.uncertainty)
        if (sure > request.limits.force).any():
            return Termination.FORCE_LIMIT
        off = there.jacobian @ (sample.q - sample.reference)
        if self._compliance is not None:
            off = off + self._compliance.drift.values
        return Termination.MOTION_LIMIT if (np.abs(off) > request.limits.motion).any() else Termination.NONE
