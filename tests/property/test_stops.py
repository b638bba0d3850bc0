"""Controlled stops in lock-step: how far the arm outruns their reference, and what they may end in."""

from __future__ import annotations

import math

import numpy as np
import pytest

from qrobot.arrays import Floats
from qrobot.config import load_robot
from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.kernels.interpolation_polynomials import FORMS
from qrobot.servo.kernels.interpolator import PEAK_SLOPE
from qrobot.servo.kernels.velocity import ESTIMATORS
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.mismatch import PlantMismatch
from tests.campaigns.stops import cases as random_cases
from tests.campaigns.stops import stop_once
from tests.support.servo_bench import cruise

PUMA = load_robot("puma560")
FRAME_S, FRAME_NS = 0.028, 28_000_000
RAMP_S, CRUISE_S, SETTLE_S = 0.3, 0.1, 0.3
OVERSHOOT_S = np.sqrt(PUMA.control.inertia / PUMA.control.kp) / math.e  # of a joint whose reference stops dead
FRICTION_RAD = 0.003  # what friction and a wrong plant add [A]
SPEEDS = (0.02, 0.3, 1.0, 1.5)
JOINTS = tuple(range(PUMA.n))


class Cruise:
    """One joint of an arm under power moves at constant speed; the others stand."""

    def __init__(self, joint: int, speed: float, start: Floats, mismatched: bool = False, **choices: object) -> None:
        mismatch = PlantMismatch.mismatched(PUMA.n) if mismatched else None
        emulator = Emulator(PUMA, start=start, physics="rigid", mismatch=mismatch)
        self.joint, self.speed = joint, speed
        self.rig = LockstepRig(PUMA, ServoSettings(**choices), emulator)  # type: ignore[arg-type]
        self.rig.ticks(3)
        self.rig.mailbox.request_power(True)
        self.rig.run_for(0.2)
        self.path = cruise(self.rig.mailbox.snapshot().q_setpoint, speed * np.eye(PUMA.n)[joint], RAMP_S)
        self.seq = 0

    @property
    def mode(self) -> Mode:
        return Mode(self.rig.mailbox.snapshot().mode)

    @property
    def event(self) -> FaultCode:
        return FaultCode(self.rig.mailbox.snapshot().event)

    def frame(self, part: float = 1.0) -> None:
        """Send the next setpoint; then so much of a frame passes."""
        values, modes = self.path(self.seq * FRAME_S).tolist(), [POSITION_SETPOINT] * PUMA.n
        self.rig.mailbox.push_setpoint(1, self.seq, self.rig.now_ns, FRAME_NS, modes, values)
        self.seq += 1
        self.rig.run_for(part * FRAME_S)

    def go(self, seconds: float) -> None:
        """Move for so long."""
        frames, part = divmod(seconds / FRAME_S, 1.0)
        for _ in range(int(frames)):
            self.frame()
        self.frame(part)
        assert (self.mode, self.event) == (Mode.TRACKING, FaultCode.NONE)

    def stop(self) -> float:
        """Ask for a stop and wait for it; how far the joint went beyond the place where its reference came to rest."""
        self.rig.mailbox.request_stop()
        places = []
        for _ in range(round(SETTLE_S / 0.005)):
            self.rig.run_for(0.005)
            places.append(self.rig.emulator.q[self.joint])
        end = self.rig.mailbox.snapshot().q_setpoint[self.joint]
        return float(max(np.sign(self.speed) * (np.array(places) - end)))


def middle() -> Floats:
    """A pose with room on both sides of every joint."""
    return np.array(PUMA.poses["ready"])


@pytest.mark.sampled(8)
@pytest.mark.parametrize("mismatched", [False, True])
@pytest.mark.parametrize("speed", SPEEDS)
@pytest.mark.parametrize("joint", JOINTS)
def test_a_stop_goes_no_further_than_a_joint_whose_reference_stops_dead(
    joint: int, speed: float, mismatched: bool
) -> None:
    """At 1.5 rad/s that is 18 mrad of the arm's joints and 11 of the wrist's; a smooth stop stays below, both ways."""
    speed = min(speed, 0.9 * PUMA.limits.v_max[joint])
    for direction in (1.0, -1.0):
        arm = Cruise(joint, direction * speed, middle(), mismatched)
        arm.go(RAMP_S + CRUISE_S)
        assert arm.stop() <= OVERSHOOT_S[joint] * speed + FRICTION_RAD
        assert (arm.mode, arm.event) == (Mode.HOLDING, FaultCode.NONE)


@pytest.mark.sampled(8)
@pytest.mark.parametrize("speed", SPEEDS)
@pytest.mark.parametrize("joint", JOINTS)
def test_a_stop_that_began_with_room_does_not_end_beyond_the_range(joint: int, speed: float) -> None:
    """Room: the way of the gentlest stop, and what the arm outruns its reference by. Both ends of the range."""
    speed = min(speed, 0.9 * PUMA.limits.v_max[joint])
    way = 0.5 * speed * max(PEAK_SLOPE * speed / PUMA.guard.a_stop[joint], 0.02)
    run = speed * (RAMP_S / 2 + CRUISE_S + 0.5 * FRAME_S)
    for end, direction in ((PUMA.limits.q_max[joint], 1.0), (PUMA.limits.q_min[joint], -1.0)):
        start = middle()
        start[joint] = end - direction * (run + way + 0.003)
        arm = Cruise(joint, direction * speed, start)
        arm.go(RAMP_S + CRUISE_S)
        arm.stop()
        assert (arm.mode, arm.event) == (Mode.HOLDING, FaultCode.NONE)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("velocity", ESTIMATORS)
@pytest.mark.parametrize("form", FORMS)
def test_a_stop_at_any_instant_in_any_form_is_a_stop_and_no_fault(form: str, velocity: str) -> None:
    random = np.random.default_rng(len(form) + 10 * len(velocity))
    for joint in JOINTS:
        speed = float(random.choice([-1.0, 1.0]) * random.uniform(0.3, 0.9) * min(PUMA.limits.v_max[joint], 1.5))
        arm = Cruise(joint, speed, middle(), velocity=velocity, interpolation=form)
        arm.go(RAMP_S + CRUISE_S * float(random.uniform(0.0, 1.0)))
        arm.stop()
        assert (arm.mode, arm.event) == (Mode.HOLDING, FaultCode.NONE), (joint, speed)


# Of 300 random ones each: false alarms of a wrong model and an unknown load, before a stop and jumps of the velocity
# were allowed for. Seeds of `python -m tests.campaigns stops`.
@pytest.mark.parametrize(
    ("form", "seeds"),
    [("linear", (8, 9, 16, 32, 57, 114, 139, 144, 177, 257)), ("cubic", (212, 276)), ("b-spline", (212, 276))],
)
def test_a_stop_of_a_random_motion_is_a_stop_and_no_fault(form: str, seeds: tuple[int, ...]) -> None:
    of_campaign = list(random_cases(max(seeds) + 1, form))
    for seed in seeds:
        assert stop_once(of_campaign[seed]) == (Mode.HOLDING, FaultCode.NONE), of_campaign[seed]
