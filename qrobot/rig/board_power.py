"""The steps with arm power of a walk through a new board: power for an instant, then short pushes on single joints."""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.config import Robot
from qrobot.hwif.registers import DAC, DAC_ZERO, DISCRETE, DISCRETE_POWER, STATUS_POWER
from qrobot.rig.board_walk import LeftOutError, StepError, Walk, joints_named, reversed_counts
from qrobot.units import M_PER_MM, RAD_PER_DEG

ALONE_S: Final = 0.3  # [A] arm power that needs no button has come by then
POWER_S: Final = 10.0  # [A] for somebody who was told to press ARM POWER
RELEASE_S: Final = 0.06  # brakes open
PUSH_S: Final = 0.04
PUSH_FRICTION: Final = 2.0  # times the friction the robot file expects: enough to move, too little to go far
PUSH_SHARES: Final = (0.05, 0.6)  # of full torque, at least and at most
PUSH_COUNTS: Final = 4  # least difference that a push must make
PUSH_AGAIN: Final = 2.0  # times as hard, where the first push was counted and hardly seen
SEEN_DEG: Final = 0.1  # somebody who looks at the joint sees which way it went [A]
SEEN_MM: Final = 0.2
STAYS: Final = "amplifier, fuse, or a brake that stays closed"


def power_for_an_instant(walk: Walk) -> str:
    """Power comes with zero torque, and goes at once."""
    walk.make_safe()
    before, begin = walk.counts(), walk.t_s
    _power_on(walk, "the brakes open for an instant")
    took_s = walk.t_s - begin
    walk.make_safe()
    if not walk.wait(0.5, lambda: not walk.status & STATUS_POWER):
        raise StepError("power does not go off", "PRESS THE EMERGENCY STOP; the power relay is stuck")
    walk.wait(0.3)
    largest = max(map(abs, walk.moved(before)))
    return f"on after {took_s * 1e3:.0f} ms, off at once; the arm moved by {largest} counts at most"


def see_ways(walk: Walk) -> str:
    """Joints that nobody has turned by hand, pushed: their counts go the way they are seen to go.

    A push against the counts and the torque of the robot file alone cannot tell: where both are reversed it is right.
    """
    left = [joint for joint in range(walk.robot.n) if joint not in walk.ways_seen]
    if not left:
        raise LeftOutError("all were turned by hand")
    told = []
    for joint in left:
        by = _pushed_to_be_seen(walk, joint) * walk.robot.transmission.rad_per_count[joint]
        if _went_up(walk, joint, by) != (by > 0):
            raise StepError(
                f"the angle of joint {joint + 1} {'rose' if by > 0 else 'fell'} by its counts; it went the other way",
                reversed_counts(walk),
            )
        walk.ways_seen.add(joint)
        told.append(f"{joint + 1}: {_distance(walk.robot, joint, by)}")
    return "counts go the way the joints go, joint " + ", ".join(told)


def _pushed_to_be_seen(walk: Walk, joint: int) -> int:
    """Counts joint `joint` stands away from where it stood, far enough for eyes, after a push or a few.

    A brake that closes moves a joint by some counts as well, so few are no answer. Who shows none at all may have a
    dead encoder, and is not pushed harder.
    """
    before, counted = walk.counts(), False
    seen = SEEN_MM * M_PER_MM if walk.robot.prismatic[joint] else SEEN_DEG * RAD_PER_DEG
    for harder in (1.0, PUSH_AGAIN):
        for side in (1, -1):
            _pushed(walk, joint, side, harder)
            by = walk.moved(before)[joint]
            counted = counted or abs(by) >= PUSH_COUNTS
            if abs(by * walk.robot.transmission.rad_per_count[joint]) >= seen:
                return by
        if not counted:
            break
    raise StepError(f"joint {joint + 1} was not moved by a push to either side", STAYS)


def _went_up(walk: Walk, joint: int, by: float) -> bool:
    """Whether the operator saw the joint go the positive way."""
    name, far = f"Joint {joint + 1} ({walk.robot.joint_names[joint]})", _distance(walk.robot, joint, abs(by))
    places = "positions" if walk.robot.prismatic[joint] else "angles"
    if walk.ask(f"{name} was pushed by {far}: does it stand further towards positive {places} than before?"):
        return True
    if walk.ask(f"{name}: does it stand further towards negative {places}?"):
        return False
    raise StepError(
        f"nobody saw which way joint {joint + 1} went", "draw a line across the joint, and make the walk again"
    )


def _distance(robot: Robot, joint: int, by: float) -> str:
    return f"{by / M_PER_MM:.2f} mm" if robot.prismatic[joint] else f"{by / RAD_PER_DEG:.2f} degrees"


def push_each_joint(walk: Walk) -> str:
    """A short push to either side: the counts must differ in the direction the robot file says."""
    told = []
    for joint in range(walk.robot.n):
        scale = walk.robot.transmission.dac_per_Nm[joint] * walk.robot.transmission.rad_per_count[joint]
        up, down = (_pushed(walk, joint, side) for side in (1, -1))
        by = (up - down) * float(np.sign(scale))
        if abs(by) < PUSH_COUNTS:
            raise StepError(f"joint {joint + 1} does not answer to torque", STAYS)
        if by < 0:
            raise StepError(f"joint {joint + 1} runs against its torque", _reversed_torque(walk, joint))
        told.append(f"{joint + 1}: {by:+.0f}")
    unseen = [joint + 1 for joint in range(walk.robot.n) if joint not in walk.ways_seen]
    beside = f"; nobody saw which way {joints_named(unseen)} went" if unseen else ""
    return "counts in the direction of torque, joint " + ", ".join(told) + beside


def _reversed_torque(walk: Walk, joint: int) -> str:
    if walk.drives is not None:  # what its counts mean has no part in it
        return "set the polarity of its drive, with its maker's tool: positive torque has to let its position rise"
    motor = "swap its motor leads, or the sign of dac_per_Nm"
    if joint in walk.ways_seen:
        return motor
    return (
        "only one of both is reversed: look which way the joint goes when its angle is shown to rise; "
        f"the wrong way: {reversed_counts(walk)}; the right way: {motor}"
    )


def _pushed(walk: Walk, joint: int, side: int, harder: float = 1.0) -> int:
    """Counts joint `joint` moved in a push to one side, `harder` times the usual; power is on only for that."""
    walk.make_safe()
    _power_on(walk, f"the brakes open, and joint {joint + 1} is pushed")
    walk.wait(RELEASE_S)
    before = walk.counts()
    walk.write((DAC + 2 * joint, DAC_ZERO + side * _push_steps(walk.robot, joint, harder)))
    walk.wait(PUSH_S)
    moved = walk.moved(before)[joint]
    walk.make_safe()
    walk.wait(0.2)
    return moved


def _push_steps(robot: Robot, joint: int, harder: float) -> int:
    """Steps of the converter that move a joint against its friction, `harder` times as many as should be needed."""
    friction = robot.friction[robot.control.friction_preset]
    largest = max(abs(friction.coulomb_pos[joint]), abs(friction.coulomb_neg[joint]))
    share = harder * PUSH_FRICTION * largest * abs(robot.transmission.dac_per_Nm[joint]) / DAC_ZERO
    return round(DAC_ZERO * float(np.clip(share, *PUSH_SHARES)))


def _power_on(walk: Walk, then: str) -> None:
    """Arm power; where it needs somebody at its button, they are told what comes `then`."""
    walk.write((DISCRETE, walk.kept | DISCRETE_POWER))
    if walk.wait(ALONE_S, lambda: bool(walk.status & STATUS_POWER)):
        return
    walk.tell(f"press ARM POWER now: at once {then}")
    if not walk.wait(POWER_S, lambda: bool(walk.status & STATUS_POWER)):
        walk.make_safe()
        raise StepError(f"no arm power within {POWER_S:.0f} s", "press ARM POWER when the walk asks for it")
