"""Force along one axis of the tool, position across it: for pressing on surfaces."""

from __future__ import annotations

import math
from typing import Any, Final

from qrobot.hwif.registers import N_ADCS
from qrobot.servo.laws.casadi_law import casadi_law
from qrobot.servo.laws.law import KP, KV, SIGNALS_AT, Setting

FORCE, NEWTON_PER_VOLT, CHANNEL, AXIS_X, AXIS_Y, AXIS_Z, REACH, CREEP, TRAVEL, GAIN, RATE, TRIM, TARE = range(
    13
)  # settings
TIME, ZERO, N_KEPT = range(3)  # memory: s, V
PRESSED, ADVANCE, CORRECTION, N_TOLD = range(SIGNALS_AT, SIGNALS_AT + 4)  # memory that is logged, too: N, m, N
SIGNALS: Final = ("pressed", "advance", "correction")

FULL_RANGE_V: Final = 9.95  # of the converter's 10: beyond, nobody knows the force
SMOOTHING_S: Final = 0.015  # of the measured force: with gain 1 a loop of this lag bears ten samples of delay [A]

SETTINGS: Final = (
    Setting("force", 20.0, 0.0, 200.0, "N", "with which the tool is to press"),
    Setting("newton_per_volt", 10.0, -1000.0, 1000.0, "N/V", "of the sensor, for a pull at the flange along the axis"),
    Setting("channel", 6.0, 0.0, 7.0, "-", "ADC channel of the sensor, one of `sensor_channels`"),
    Setting("axis_x", 0.0, -1.0, 1.0, "-", "direction to press in, in the frame of the flange"),
    Setting("axis_y", 0.0, -1.0, 1.0, "-", "its y"),
    Setting("axis_z", 1.0, -1.0, 1.0, "-", "its z"),
    Setting("reach", 0.1, 0.0, 2.0, "m", "from the flange to the tip, along z"),
    Setting("creep", 0.01, 0.0, 0.1, "m/s", "speed of the search for something to press on"),
    Setting("travel", 0.02, 0.0, 0.5, "m", "how far beyond the setpoint the search goes"),
    Setting("gain", 1.0, 0.0, 2.0, "-", "newtons more for each that is missing"),
    Setting("rate", 8.0, 0.0, 50.0, "1/s", "of the integral that makes up for friction"),
    Setting("trim", 15.0, 0.0, 200.0, "N", "what that integral adds or takes at most"),
    Setting("tare", 0.25, 0.01, 10.0, "s", "after switching on, in which the sensor's zero is found: touch nothing"),
)


@casadi_law(settings=SETTINGS, signals=SIGNALS)
def force(
    robot: Any,
    arm: Any,
    q_ref: Any,
    v_ref: Any,
    q: Any,
    v: Any,
    gravity: Any,
    friction: Any,
    sensors: Any,
    gains: Any,
    settings: Any,
    memory: Any,
    dt: Any,
) -> Any:
    """Press with a force along an axis of the tool, and hold the others: impedance with a bounded spring.

    tau = Kp e + Kv de + friction(v_ref) + gravity(q) + J' (min(k (J e + x), u) - k J e), with e = q_ref - q, J the
    Jacobian of the tip along the axis and k = 1 / (J Kp^-1 J'), the stiffness that Kp gives the tip. x creeps ahead
    while the spring pulls less than u; u is the force and, of what the sensor misses in it, a share and an integral.
    """
    import casadi

    axis = casadi.vertcat(settings[AXIS_X], settings[AXIS_Y], settings[AXIS_Z])
    jacobian = _jacobian_along(arm, q, axis, robot.geometry.flange_m + settings[REACH])
    kp, kv, error = gains[KP, :].T, gains[KV, :].T, q_ref - q
    stiffness = 1.0 / (jacobian @ (jacobian.T / kp))
    pull = stiffness * (jacobian @ error)

    volts = _pick(sensors, settings[CHANNEL])
    time = memory[TIME] + dt
    taring = time <= settings[TARE]
    zero = casadi.if_else(taring, memory[ZERO] + (volts - memory[ZERO]) * dt / time, memory[ZERO])
    felt = casadi.if_else(taring, 0.0, -(volts - zero) * settings[NEWTON_PER_VOLT])
    pressed = memory[PRESSED] + (felt - memory[PRESSED]) * dt / (SMOOTHING_S + dt)

    missing = settings[FORCE] - pressed
    most = casadi.fmax(settings[FORCE] + settings[GAIN] * missing + memory[CORRECTION], 0.0)
    enough = (most - pull) / stiffness
    wanted = casadi.if_else(taring, 0.0, casadi.fmin(memory[ADVANCE] + settings[CREEP] * dt, settings[TRAVEL]))
    ahead = casadi.fmax(0.0, casadi.fmin(wanted, enough))
    spring = casadi.fmin(pull + stiffness * ahead, most)

    grown = memory[CORRECTION] + casadi.if_else(wanted < enough, 0.0, settings[RATE] * missing * dt)
    correction = casadi.fmax(-settings[TRIM], casadi.fmin(grown, settings[TRIM]))

    tau = kp * error + kv * (v_ref - v) + friction + gravity + jacobian.T @ (spring - pull)
    tau = casadi.if_else(casadi.fabs(volts) < FULL_RANGE_V, tau, math.nan)  # also when they are NaN
    return tau, casadi.vertcat(time, zero, memory[N_KEPT:SIGNALS_AT], pressed, ahead, correction, memory[N_TOLD:])


def _jacobian_along(arm: Any, q: Any, axis: Any, reach: Any) -> Any:
    """Velocity of the tip along `axis` (3), of the last frame, for each joint's. The tip is `reach` along its z."""
    import casadi

    from qrobot.codegen.rigid_body import last_frame  # loads CasADi

    turn, origin = last_frame(arm, q)
    tip = origin + reach * turn[:, 2]
    return (turn @ axis / casadi.norm_2(axis)).T @ casadi.jacobian(tip, q)


def _pick(sensors: Any, channel: Any) -> Any:
    """The sensor of a channel that is only known later; NaN in others does not come through."""
    import casadi

    return sum(casadi.if_else(channel == i, sensors[i], 0.0) for i in range(N_ADCS))
