"""Robot file and settings, boiled down to the numbers the cycle works with.

Everything is an array or a plain number, so that the compiled cycle takes it as it is. The control-side model comes
from the robot file alone; the plant behind an emulated board may differ.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np

from qrobot.config import Robot
from qrobot.fences.gate import GATE
from qrobot.fences.table import N_WORDS
from qrobot.model.dynamics import DynamicsParams, FrictionParams, dynamics_params, friction_params
from qrobot.model.transmission import TransmissionParams, transmission_params
from qrobot.realtime.flat_record import record_of
from qrobot.servo.analog_lines import AnalogParams, analog_params
from qrobot.servo.calibration.table import CalibrationParams, calibration_params
from qrobot.servo.checks.monitor_state import WatchParams, watch_params
from qrobot.servo.kernels.interpolation_polynomials import find_form
from qrobot.servo.kernels.velocity import find_estimator
from qrobot.servo.kernels.wrench import WrenchParams, wrench_params
from qrobot.servo.laws.law import KP, KV, M0, N_GAINS
from qrobot.servo.neighbour import PATIENCE_S
from qrobot.servo.output_lines import OutputParams, output_params
from qrobot.servo.settings import ServoSettings
from qrobot.servo.speed_share import speed_share
from qrobot.units import NS_PER_MS, NS_PER_S

UNCHANGED_IMAGES: Final = 4  # so many cycles without a new image are never held against the board
POWER_TIMEOUT_NS: Final = 3 * NS_PER_S
GUARDIAN_PERIODS: Final = 2  # the guardian's heartbeat may be as old as so many of its bounds
PUT_BACK_NS: Final = NS_PER_S  # by which the time of an emulated arm is put back at once, at most [A]
STANDSTILL_RAD_S: Final = 0.05  # faster than this the arm is not at rest: no power, no zero of its force sensor
SHORTEST_STOP_S: Final = 0.02
ADC_PATIENCE_NS: Final = 20_000_000  # a conversion takes microseconds, its way through a slow bus milliseconds
ADC_PATIENCE_CYCLES: Final = 8
EXCHANGES_TO_ANSWER: Final = 6  # with a board behind a gateway [A]: an image can answer after three, or be late
# Calibration [A]: slow enough for hundreds of potentiometer readings a turn, 0.15 to 0.3 rad/s on a PUMA 560.
CREEP_TURNS_S: Final = 2.5  # motor turns a second
CREEP_SHARE: Final = 0.25  # of the joint's greatest speed, at most
CREEP_RISE_S: Final = 0.2
CREEP_TORQUE: Final = 0.6  # of the guard's limit: weight and friction take 40 %
SETTLE_NS: Final = 100_000_000  # no counter moves for so long before they are loaded
SETTLE_PATIENCE_NS: Final = 5 * NS_PER_S
LOAD_PATIENCE_NS: Final = 50_000_000
JUMP_FACTOR: Final = 2.0  # counts in one tick beyond so many times what the fastest joints make are a glitch
JUMP_FLOOR_COUNTS: Final = 20.0
NO_TORQUE: Final = -1.0
SAMPLING_SLACK: Final = 1.1  # differences of sampled setpoints overshoot the true derivative a little


class ServoParameters(NamedTuple):
    """Constants of one servo. Vectors have shape (n,) and SI units.

    The default law feeds no acceleration forward, so the arm outruns the reference of a stop. A critically damped joint
    of natural frequency w = sqrt(Kp / M0) whose reference stops dead goes on by v t exp(-w t), at most v / (e w); a
    smooth stop stays below that.
    """

    period_ns: int
    transmission: TransmissionParams
    dynamics: DynamicsParams
    friction: FrictionParams
    gravity_share: Any  # 1 where gravity is compensated, 0 elsewhere
    gains: Any  # (3, n): Kp, Kv, M0
    inertia: Any  # M0, of the observer
    estimator: int  # see `servo.kernels.velocity`
    filter_rad_s: float
    observer_rad_s: float
    form: Any  # (6, 4), see `servo.kernels.interpolation_polynomials`
    first_knot: int
    q_min: Any
    q_max: Any
    v_max: Any
    v_setpoint: Any
    a_setpoint: Any
    a_stop: Any
    stop_overshoot_s: Any  # how far the arm outruns the reference of a stop, in seconds of its speed
    tau_max: Any
    tau_setpoint: Any  # the most a torque setpoint may ask for; below zero where none may come
    position_drives: int  # 1: drives close the loop, and get the reference instead of torque
    tool_speed: float  # the most of the tool's tip, m/s; 0 for no limit but those of the joints
    speed_share: float  # of the greatest speeds of the joints, which programs may plan
    flange_m: float  # of the flange from the last frame, along its z
    tip: Any  # (3,) where it is in the frame of the last link
    following_error: Any
    range_margin: Any
    velocity_factor: float
    start_tolerance: float
    jump_counts: Any
    late_ns: int
    unchanged_images: int  # cycles without a new image until the board counts as gone
    image_age_ns: int  # an image older than this is no image
    board_slips: int  # 1: an emulated board may let time stand still, see `hwif.arm_clock`
    guardian_timeout_ns: int  # 0: none required
    power_timeout_ns: int
    shortest_stop_s: float
    sensor_mask: int  # ADC channels that are always sampled
    wrench: WrenchParams
    adc_patience: int  # cycles a conversion may take
    index_phase: Any  # int64[n] index pulse modulo counts_per_rev
    pot_channel: Any  # int64[n]
    pots: int  # 1: potentiometers may be looked at without a calibration table
    calibration: CalibrationParams
    creep_speed: Any  # while calibrating
    creep_acceleration: Any
    creep_torque: Any
    settle_cycles: int
    settle_patience: int
    load_patience: int
    watch: WatchParams
    outputs: OutputParams
    analog: AnalogParams
    fence_gate: int  # address of the kernel that judges fences, see `fences.gate`; 0 for none
    fence_words: Any  # see `fences.table`
    neighbour_patience: int  # cycles without a look at other arms, see `servo.neighbour`; 0 for none
    n_neighbours: int


def servo_parameters(robot: Robot, settings: ServoSettings, guarded: bool | None = None) -> ServoParameters:
    """The constants of a servo for `robot`; `guarded` overrides the settings (lock-step has no guardian)."""
    control, guard, limits = robot.control, robot.guard, robot.limits
    form = find_form(settings.interpolation)
    gains = np.zeros((N_GAINS, robot.n))
    gains[KP], gains[KV], gains[M0] = control.kp, control.kv, control.inertia
    counts_per_tick = robot.transmission.count_rates(limits.v_max) * settings.period_ns / NS_PER_S
    turn = 2.0 * math.pi / robot.transmission.gear
    creep = np.minimum(CREEP_TURNS_S * turn, CREEP_SHARE * limits.v_max)
    needs_guardian = settings.guarded if guarded is None else guarded
    guardian_ns = int(GUARDIAN_PERIODS * settings.guardian_timeout_ms * 1e6)
    unchanged = max(UNCHANGED_IMAGES, math.ceil(settings.board_timeout_ms * 1e6 / settings.period_ns))
    tip = np.array([0.0, 0.0, robot.geometry.flange_m]) + np.array(settings.tool_m)
    return record_of(
        ServoParameters(
            period_ns=settings.period_ns,
            transmission=transmission_params(robot),
            dynamics=dynamics_params(robot),
            friction=friction_params(robot),
            gravity_share=control.gravity_joints.astype(np.float64),
            gains=gains,
            inertia=np.array(control.inertia),
            estimator=int(find_estimator(settings.velocity)),
            filter_rad_s=2.0 * math.pi * control.velocity_filter_hz,
            observer_rad_s=2.0 * math.pi * control.velocity_observer_hz,
            form=form.table,
            first_knot=form.first_knot,
            q_min=np.array(limits.q_min),
            q_max=np.array(limits.q_max),
            v_max=np.array(limits.v_max),
            v_setpoint=SAMPLING_SLACK * limits.v_max,
            a_setpoint=SAMPLING_SLACK * limits.a_max,
            a_stop=np.array(guard.a_stop),
            stop_overshoot_s=control.stop_overshoot_s,
            tau_max=np.array(guard.tau_max),
            tau_setpoint=np.full(robot.n, NO_TORQUE) if settings.position_drives else np.array(guard.tau_max),
            position_drives=int(settings.position_drives),
            tool_speed=settings.reduced_speed_m_s,
            speed_share=speed_share(robot, tip, settings.reduced_speed_m_s),
            flange_m=robot.geometry.flange_m,
            tip=tip,
            following_error=np.array(guard.following_error),
            range_margin=np.array(guard.range_margin),
            velocity_factor=guard.velocity_factor,
            start_tolerance=guard.start_tolerance,
            jump_counts=np.ceil(JUMP_FACTOR * counts_per_tick + JUMP_FLOOR_COUNTS).astype(np.int64),
            late_ns=settings.period_ns // 2,
            unchanged_images=unchanged,
            image_age_ns=unchanged * settings.period_ns,
            board_slips=int(settings.board_slips),
            guardian_timeout_ns=guardian_ns if needs_guardian else 0,
            power_timeout_ns=POWER_TIMEOUT_NS,
            shortest_stop_s=SHORTEST_STOP_S,
            sensor_mask=sum(1 << channel for channel in settings.sampled_channels),
            wrench=wrench_params(settings.force_sensor),
            adc_patience=_patience_cycles(settings, ADC_PATIENCE_NS),
            index_phase=np.array(robot.transmission.index_phase),
            pot_channel=np.array(robot.transmission.pot_channels),
            pots=int(settings.pots and not settings.position_drives),
            calibration=calibration_params(robot.n, settings.calibration),
            creep_speed=creep,
            creep_acceleration=creep / CREEP_RISE_S,
            creep_torque=CREEP_TORQUE * robot.guard.tau_max,
            settle_cycles=math.ceil(SETTLE_NS / settings.period_ns),
            settle_patience=math.ceil(SETTLE_PATIENCE_NS / settings.period_ns),
            load_patience=_patience_cycles(settings, LOAD_PATIENCE_NS),
            watch=watch_params(robot, settings),
            outputs=output_params(settings.outputs),
            analog=analog_params(settings.analog_outputs, robot.n),
            fence_gate=0 if settings.fences is None else GATE.address,
            fence_words=np.zeros(N_WORDS) if settings.fences is None else np.array(settings.fences.words),
            neighbour_patience=math.ceil(PATIENCE_S * settings.rate_hz) if settings.neighbours else 0,
            n_neighbours=len(settings.neighbours),
        )
    )


def _patience_cycles(settings: ServoSettings, patience_ns: int) -> int:
    """Cycles to wait for an answer of the board: for so long, or longer where the way to it is slow."""
    exchanges_ns = EXCHANGES_TO_ANSWER * settings.exchange_ms * NS_PER_MS
    return max(ADC_PATIENCE_CYCLES, math.ceil(max(patience_ns, exchanges_ns) / settings.period_ns))
