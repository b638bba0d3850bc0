"""Operator requests about the speed of motions and the load of the arm: what they do to the servo memory."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from qrobot.config import Robot
from qrobot.config.collision import threshold_objection, torque_objection
from qrobot.errors import ConfigError, QRobotError
from qrobot.model.payload_judge import PayloadJudge
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.operator.messages import ChangeCollision, ChangeOverride, ChangePayload, PauseRequest, ResumeRequest
from qrobot.units import NS_PER_S
from qrobot.wire import CollisionReaction, Payload

CARRIED_S: Final = 0.5  # in which a servo goes over to a payload (`servo.stages.payload`)
REACTIONS: Final = tuple(reaction.name.lower() for reaction in CollisionReaction)


def set_speed(mailbox: ServoMailbox, request: ChangeOverride | PauseRequest | ResumeRequest) -> str:
    """Hand override or pause to the servo, at once. The line that tells people."""
    if isinstance(request, ChangeOverride):
        mailbox.request_override(request.factor)
        return f"speed override {request.factor:.0%}"
    if isinstance(request, PauseRequest):
        mailbox.request_pause(True)
        return "motions paused"
    mailbox.request_resume()
    return "motions resumed"


def set_payload(
    mailbox: ServoMailbox, request: ChangePayload, judge: PayloadJudge, say: Callable[[str], None]
) -> Callable[[], bool]:
    """Hand a payload to the servo; tells whether it is in force. Raises QRobotError where the arm cannot carry it."""
    payload = Payload(request.mass, request.centre, request.inertia)
    if objection := judge.objection(payload):
        raise QRobotError(objection)
    before = mailbox.snapshot()
    mailbox.request_payload(payload)
    x, y, z = payload.centre
    say(f"payload {payload.mass:g} kg at {x:g}, {y:g}, {z:g} m from the flange")

    def in_force() -> bool:
        """A payload of the same mass shows by nothing: it is in force when its time has passed."""
        now = mailbox.snapshot()
        waited = before.payload_mass != payload.mass or now.t_ns - before.t_ns > CARRIED_S * NS_PER_S
        return bool(now.payload_mass == payload.mass and waited)

    return in_force


def set_collision(mailbox: ServoMailbox, request: ChangeCollision, robot: Robot, torques_known: bool) -> str:
    """Hand thresholds and reaction to the servo, at once. The line that tells people.

    Raises ConfigError for thresholds that would tell of less, and for an arm whose collisions nobody can tell.
    """
    asked, reaction = request.thresholds, REACTIONS.index(request.reaction)
    if objection := torque_objection(asked, reaction, torques_known):
        raise ConfigError(f"collisions: {objection}")
    if asked and (objection := threshold_objection(robot, asked)):
        raise ConfigError(objection)
    mailbox.request_collision(asked, reaction)
    told = " ".join(f"{threshold:g}" for threshold in asked) or "of the robot file"
    return f"collisions: thresholds {told}, then {request.reaction}"
