"""Status of the servo, as an operator is told it."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.faultcodes import NO_JOINT, FaultCode, explain
from qrobot.hwif.arm_clock import arm_time_ns
from qrobot.modecodes import Mode, mode_name
from qrobot.servo.laws.law import KP, KV, M0
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.published_state import FLAG_CALIBRATED, FLAG_ESTOP_OK, FLAG_GUARDED, FLAG_POWERED
from qrobot.servo.memory.servo_memory import TAKEN
from qrobot.servo.operator.board_status import board_status
from qrobot.servo.operator.controlled import Controlled
from qrobot.servo.operator.messages import ServoStatus
from qrobot.units import NS_PER_S
from qrobot.wire.vocabulary import CollisionReaction

GUARD_TRIP: Final = int(FaultCode.GUARD_TRIP)
HANDS: Final = ("relaxed", "open", "closed")  # by COMMAND_HAND
HANGS: Final = (
    "the servo's loop does not run, as in a law that never comes back; the guardian has taken torque and power. "
    "End the servo of {arm} (SIGTERM, or Ctrl-C of `qrobot up`) and start it again"
)
HUNG_NS: Final = 500_000_000  # [A] since the last cycle, as the guardian sees it: no stall that passes
INPUTS: Final = range(1, 6)  # input 0 is the emergency stop's


def guardian_acts(mailbox: ServoMailbox) -> bool:
    """The guardian has taken torque and power away, and the servo writes nothing until it is given the board back."""
    return bool(mailbox.memory.guardian.takeover == TAKEN)


def servo_status(servo: Controlled, commander: str) -> ServoStatus:
    """Status of the servo now, which `commander` commands, "" for nobody. Raises LinkError when it died."""
    snapshot, taken_over = servo.mailbox.snapshot(), guardian_acts(servo.mailbox)
    gains = servo.swap.gains
    mode, fault = (Mode.FAULT, GUARD_TRIP) if taken_over else (snapshot.mode, snapshot.fault)
    code = fault or snapshot.event
    joint = snapshot.event_joint if code == snapshot.event else NO_JOINT
    return ServoStatus(
        arm=servo.arm,
        robot=servo.robot.name,
        rate_hz=servo.mailbox.info.rate_hz,
        law=servo.law_name,
        law_settings=servo.law.chosen,
        mode=mode_name(mode),
        fault=fault,
        event=snapshot.event,
        event_joint=snapshot.event_joint,
        text=_hung(servo) or _text(servo, code, joint),
        powered=bool(snapshot.flags & FLAG_POWERED) and not taken_over,
        calibrated=bool(snapshot.flags & FLAG_CALIBRATED),
        estop_ok=bool(snapshot.flags & FLAG_ESTOP_OK),
        guarded=bool(snapshot.flags & FLAG_GUARDED),
        commander=commander,
        tick=snapshot.tick,
        late_cycles=snapshot.late_cycles,
        page_faults=servo.page_faults,
        missed_frames=snapshot.missed_frames,
        hand=HANDS[snapshot.hand] if 0 <= snapshot.hand < len(HANDS) else "",
        inputs=tuple(k for k in INPUTS if snapshot.inputs >> k & 1),
        outputs={wire.name: bool(snapshot.outputs & wire.mask) for wire in servo.settings.outputs},
        analog_outputs={
            wire.name: float(snapshot.analog_outputs[wire.output - 1]) for wire in servo.settings.analog_outputs
        },
        force=tuple(None if math.isnan(value) else value for value in snapshot.force.tolist()),
        override=snapshot.override if snapshot.tick else 1.0,  # before the first cycle nobody has asked for another
        paused=snapshot.paused,
        path_waits=servo.mailbox.path_waits(snapshot.t_ns),
        speed_limit=snapshot.speed_limit,
        tool_speed_limit=snapshot.tool_speed_limit,
        payload_mass=snapshot.payload_mass,
        collision_thresholds=floats(_collision_thresholds(servo)),
        collision_reaction=_collision_reaction(servo.mailbox),
        q=floats(snapshot.q),
        v=floats(snapshot.v),
        tau=floats(snapshot.tau),
        kp=floats(gains[KP]),
        kv=floats(gains[KV]),
        inertia=floats(gains[M0]),
        board=board_status(servo.board.memory, lambda: arm_time_ns(servo.board.memory, servo.settings.board_slips)),
    )


def _collision_thresholds(servo: Controlled) -> Floats:
    """Thresholds of the newest request, and the robot file's where it says nothing. Shape (n,), N m (N)."""
    usual = servo.robot.guard.unexplained_torque_or_default
    asked = servo.mailbox.memory.command.collision_thresholds[: usual.size]
    return np.where(asked > 0.0, np.minimum(asked, usual), usual)


def _collision_reaction(mailbox: ServoMailbox) -> str:
    comply = mailbox.memory.command.collision_reaction == CollisionReaction.COMPLY
    return (CollisionReaction.COMPLY if comply else CollisionReaction.STOP).name.lower()


def floats(vector: Any) -> tuple[float, ...]:
    """Numbers of a vector, for a message."""
    return tuple(np.asarray(vector).tolist())


def _hung(servo: Controlled) -> str:
    """Words on a loop that does not come back, and how old is what it told; empty while the guardian does not act."""
    front = servo.mailbox.memory
    still_ns = int(front.guardian.t_ns) - int(front.heartbeat.t_ns)
    if not guardian_acts(servo.mailbox) or still_ns < HUNG_NS:
        return ""
    return f"{HANGS.format(arm=servo.arm)}. What it tells of the arm is {still_ns / NS_PER_S:.0f} s old"


def _text(servo: Controlled, code: int, joint: int) -> str:
    """Meaning of a code, with the value measured if it is the reason for which the servo last left a mode.

    A collision of an arm that holds ends no mode: an older one of another joint is not its reason.
    """
    incident = servo.incident
    if incident is not None and incident.code == code and joint in (NO_JOINT, incident.joint):
        return incident.why(servo.robot.prismatic)
    return explain(code, joint) if code else ""
