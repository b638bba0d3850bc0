"""State of the monitors of motors, brakes and timing from cycle to cycle, and the numbers they judge by."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from qrobot.config import Robot
from qrobot.config.deployment import SLOWEST_SERVO_HZ
from qrobot.errors import ConfigError
from qrobot.model.dynamics import DynamicsParams, dynamics_params, with_payload
from qrobot.servo.checks.momentum_observer import STALE
from qrobot.servo.kernels.interpolation_polynomials import find_form
from qrobot.servo.memory.stop_record import INCIDENT_WORDS
from qrobot.servo.settings import ServoSettings
from qrobot.units import NS_PER_S

PACE_PER_S: Final = 200.0  # of the momentum observer: 5 ms, about what the velocity's low pass takes
FASTEST_SHARE: Final = 0.5  # of a deviation the observer may take back in one cycle; slow servos have a slower one
MOST_UNSEEN: Final = STALE / 1.15  # of its time constants between two exchanges: they are not even [A]
# Friction as commanded torque, over the Coulomb friction of the robot file, where that is a third too low, sticks by a
# factor of 1.3 and the motor gives a fifth too little [A]: at break-away, and beyond that of the sliding joint.
HELD_SHARE: Final = 1.3 * 1.3 / 0.8
RISE_SHARE: Final = 0.3 * 1.3 / 0.8
RESTLESS_COUNTS: Final = 2.0  # between two counts the position loop goes on by so many, however coarse they are [A]
IMPOSSIBLE_TORQUE: Final = 2.0  # times the torque limit: nothing stops a joint like that
PROOF_TURNS: Final = 0.25  # of the motor, net, the way of its torque: the sign is right [A]; backlash is a hundredth


class WatchParams(NamedTuple):
    """Thresholds. Vectors have shape (n,) and SI units."""

    unexplained: Any  # torque, N m (N), that no wrong parameter of the model explains
    impossible: Any  # torque, N m (N), that nothing stops a joint with
    runaway_speed: Any  # rad/s (m/s) beyond the reference's
    pace: float  # of the momentum observer, 1/s
    braked: Any  # 1 where the joint has a brake, int64
    brake_slip: Any  # rad (m)
    unit_per_count: Any  # rad (m) a count stands for, positive
    count_way: Any  # 1 or -1: which way the joint goes when counts rise, int64
    proof: Any  # counts along its torque after which a motor's sign is right
    holds_up: Any  # upward torque of a motor, N m (N), that friction and unknown load may take up without motion
    holds_down: Any  # the same, downward
    rise_up: Any  # from a motor's sliding torque to break-away, N m (N)
    rise_down: Any
    unknown_load: Any  # N m (N)
    root_inertia: Any  # sqrt of M0
    heaviest: DynamicsParams  # of the heaviest load alone, without weight
    jumps: int  # 1: the velocity of the reference jumps at setpoints
    jolt_per_jump: Any  # Kv / M0, 1/s: acceleration a jump asks for
    jolt_per_step: Any  # Kp / M0, 1/s2: acceleration a step of the reference asks for
    jolt_max: Any  # tau_max / M0, rad/s2 (m/s2)
    saturation_s: float
    misses_in_a_row: int  # 0: never too many
    misses_allowed: int  # in one window
    window_points: int


@dataclass(eq=False)
class WatchState:
    """Mutable arrays. Vectors have shape (n,) and SI units."""

    load: Any  # gravity at the measured pose on every joint, N m (N)
    drive: Any  # torque beyond load and friction, as late as the estimate of velocity, N m (N)
    expected: Any  # momentum the torques account for, N m s (N s)
    push: Any  # torque nobody commanded, N m (N)
    threshold: Any  # of that torque, N m (N): beyond it something is wrong, or in the way
    asked: Any  # threshold that a program wants, 0 for none
    met: Any  # where the joint was when it began to give way softly
    soft: Any  # 1: it gives way softly, int64
    over_s: Any  # for how long it has been above its threshold
    counts: Any  # encoder counts at the last sample, int64
    counts_on: Any  # encoder counts when power came on, int64
    still_s: Any  # for how long they have not changed
    step: Any  # counts of the newest sample, positive with the joint, int64
    along: Any  # counts along the torque since power came on, see `motor_fault_diagnosis.counts_along`, int64
    travel: Any  # counts since the motor last turned round, positive with the joint, int64
    going: Any  # 1: its reference has gone on that way since the last count, int64
    slid: Any  # motor torque beyond the load that slid it when the encoder last counted, at most, N m (N)
    push_least: Any  # motor torque beyond the load since the newest image, the least and the greatest, N m (N)
    push_most: Any
    missing_v: Any  # speed and way of the joint since then, as far as they are sure, see `servo.checks.dead_encoder`
    missing: Any
    q_ref_then: Any  # reference at the last count
    swept_then: Any  # way of all references when it last counted
    bend: Any  # size of the reference's acceleration, of late
    jolt: Any  # of `bend`, what no program plans: a stop's, and jumps of the reference's velocity
    late: Any  # the same with what makes up for every cycle that is late, however little
    v_ref_before: Any  # of the cycle before
    inertial: Any  # what other joints' acceleration may put on it, of late, N m (N)
    carried: Any  # torque for the heaviest load to follow the reference, N m (N)
    planned: Any  # push that it may make, with torques off scale, of late, N m (N)
    allowed: Any  # push that a wrong model may make of such accelerations, N m (N)
    driven: Any  # 1: its reference has gone on since the last count, int64
    v_moving: Any  # velocity of the motor when its counts last changed, see `motor_fault_diagnosis.counted_speed`
    gave_way: Any  # velocity of its reference when it gave way in this stop, see `servo.stages.collision_stop`
    clipped_s: Any  # for how long the torque has been at its limit
    q_parked: Any  # where the arm came to rest without power
    incident: Any  # int64[INCIDENT_WORDS], see `servo.memory.stop_record`
    late_row: int = 0  # cycles in a row that were late or followed skipped ones
    points: int = 0  # points of the time grid in the present window
    misses_seen: int = 0  # of these, late or skipped
    slow_row: int = 0  # cycles in a row that took longer than their period
    heavy_row: int = 0  # cycles in a row that took longer than half of it
    losses_told: int = 0  # of remote modules, but for those that wait to be told
    reaction: int = 0  # to a collision, see `servo.stages.collision_stop`
    yields: int = 0  # 1: the stop going on ends where the arm is, not where its reference is
    unpowered_s: float = 0.0  # for how long the arm has been seen without power
    sample_s: float = 0.0  # between the newest two samples of the encoders
    swept: float = 0.0  # way of all references together, rad (m)
    work: float = 0.0  # of the torques nobody commanded, of late, J


def observer_pace(settings: ServoSettings) -> float:
    """Pace of the momentum observer at the servo's rate, 1/s."""
    return min(PACE_PER_S, FASTEST_SHARE / (settings.period_ns / NS_PER_S))


def check_exchanges(settings: ServoSettings) -> None:
    """Refuse a board that is asked so seldom that the watch over the motors would begin anew with each of its images.

    Raises ConfigError with the rate that the servo may have, and how often the board is to be asked for this one.
    """
    longest_ms = 1e3 * MOST_UNSEEN / observer_pace(settings)
    if settings.position_drives or settings.exchange_ms <= longest_ms:
        return
    highest_hz = math.floor(1e3 * MOST_UNSEEN / (FASTEST_SHARE * settings.exchange_ms))
    lower = f"lower rate_hz to {highest_hz} at most, or " if highest_hz >= SLOWEST_SERVO_HZ else ""
    raise ConfigError(
        f"a servo of {settings.rate_hz:g} Hz would notice no collision and no dead encoder behind a board that is "
        f"asked every {settings.exchange_ms:g} ms: {lower}ask the board every "
        f"{math.floor(100.0 * longest_ms) / 100.0:g} ms at least (period_ms)"
    )


def watch_params(robot: Robot, settings: ServoSettings) -> WatchParams:
    """Thresholds for `robot` at the servo's rate.

    Drives that close their own loop tell no torque: what could only be judged by one is then never found too large.
    """
    torque = np.inf if settings.position_drives else 1.0
    guard, period_s = robot.guard, settings.period_ns / NS_PER_S
    friction, load = robot.friction[robot.control.friction_preset], guard.unknown_load_or_default
    unit_per_count = np.abs(robot.transmission.rad_per_count)
    step = RESTLESS_COUNTS * robot.control.kp * unit_per_count
    points = max(1, round(settings.overrun.window_s / period_s))
    return WatchParams(
        unexplained=torque * guard.unexplained_torque_or_default,
        impossible=torque * IMPOSSIBLE_TORQUE * guard.tau_max,
        runaway_speed=robot.limits.v_max * guard.runaway_share,
        pace=observer_pace(settings),
        braked=np.array(robot.transmission.brake, dtype=np.int64),
        brake_slip=guard.brake_slip * np.ones(robot.n),
        unit_per_count=unit_per_count,
        count_way=np.sign(robot.transmission.rad_per_count).astype(np.int64),
        proof=PROOF_TURNS * robot.transmission.counts_per_rev,
        holds_up=torque * (HELD_SHARE * friction.coulomb_pos + load + step),
        holds_down=torque * (HELD_SHARE * friction.coulomb_neg + load + step),
        rise_up=torque * (RISE_SHARE * friction.coulomb_pos + step),
        rise_down=torque * (RISE_SHARE * friction.coulomb_neg + step),
        unknown_load=load * np.ones(robot.n),
        root_inertia=np.sqrt(robot.control.inertia),
        heaviest=heaviest_load(robot),
        jumps=int(find_form(settings.interpolation).continuity == 0),
        jolt_per_jump=robot.control.kv / robot.control.inertia,
        jolt_per_step=robot.control.kp / robot.control.inertia,
        jolt_max=guard.tau_max / robot.control.inertia,
        saturation_s=guard.saturation_s,
        misses_in_a_row=settings.overrun.misses_in_a_row,
        misses_allowed=int(settings.overrun.late_share * points),
        window_points=points,
    )


def heaviest_load(robot: Robot) -> DynamicsParams:
    """Model of the heaviest load that the arm may carry, a point at the flange of an arm that weighs nothing."""
    bare = dynamics_params(robot)
    for each in (bare.mass, bare.moment, bare.inertia, bare.armature, bare.gravity):
        each[:] = 0.0
    return with_payload(bare, robot.limits.payload_kg, np.array([0.0, 0.0, robot.geometry.flange_m]))


def make_watch_state(n: int) -> WatchState:
    """State of the monitors of `n` joints before the first cycle."""

    def vector() -> Any:
        return np.zeros(n)

    def integers(size: int) -> Any:
        return np.zeros(size, dtype=np.int64)

    return WatchState(
        load=vector(), drive=vector(), expected=vector(), push=vector(),
        threshold=vector(), asked=vector(), met=vector(), soft=integers(n),
        over_s=vector(), step=integers(n), along=integers(n),
        counts=integers(n), counts_on=integers(n), still_s=vector(), v_moving=vector(),
        travel=integers(n), going=integers(n), slid=vector(), push_least=vector(), push_most=vector(),
        missing_v=vector(), missing=vector(), q_ref_then=vector(), swept_then=vector(), bend=vector(), jolt=vector(),
        late=vector(), v_ref_before=vector(), inertial=vector(), carried=vector(), planned=vector(), allowed=vector(),
        driven=integers(n), gave_way=vector(), clipped_s=vector(), q_parked=vector(), incident=integers(INCIDENT_WORDS),
    )  # fmt: skip
