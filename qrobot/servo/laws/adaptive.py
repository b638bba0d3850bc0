"""Computed torque that finds out what is in the hand."""

from __future__ import annotations

from typing import Any, Final

from qrobot.servo.laws.casadi_law import casadi_law
from qrobot.servo.laws.law import KP, KV, M0, MEMORY_WORDS, Setting

HORIZON, USE, RESET = range(3)  # settings
SUMS, LOAD, SPREAD, APPLIED = 0, 14, 18, 22  # memory: 14 sums, 4 of the load, 4 deviations, n torques

SETTINGS: Final = (
    Setting("horizon", 10.0, 0.5, 600.0, "s", "of motion, after which what was learnt counts by 1/e"),
    Setting("use", 1.0, 0.0, 1.0, "-", "share of the load found that is borne; 0 only watches"),
    Setting("reset", 0.0, 0.0, 1.0, "-", "1: know nothing of a load, and learn nothing"),
)


@casadi_law(settings=SETTINGS)
def adaptive(
    robot: Any, arm: Any, q_ref: Any, v_ref: Any, a_ref: Any, q: Any, v: Any, friction: Any, gains: Any,
    settings: Any, memory: Any, dt: Any,
) -> Any:  # fmt: skip
    """Computed torque with the load in the hand, found while the arm moves by recursive least squares that forget.

    The load, mass and first moments, is what the torques of the cycle before gave beyond the model; it is borne like a
    link's weight, as far as `use` says. It needs a model that is right without the load: identify the arm first.
    """
    import casadi

    from qrobot.codegen.load import load_columns, load_step
    from qrobot.codegen.rigid_body import inverse_dynamics

    n, gravity = robot.n, casadi.SX(robot.geometry.gravity_m_s2)
    pace = casadi.vertcat(dt, settings[HORIZON])
    applied, sums = memory[APPLIED : APPLIED + n], memory[SUMS:LOAD] * (1.0 - settings[RESET])
    found = load_step(robot, arm, q, v_ref, a_ref, friction, applied, sums, pace)
    load = settings[USE] * (1.0 - settings[RESET]) * found.theta

    kp, kv, m0 = (gains[row, :].T for row in (KP, KV, M0))
    acceleration = a_ref + (kv * (v_ref - v) + kp * (q_ref - q)) / m0
    tau = inverse_dynamics(arm, q, v, acceleration, gravity) + friction
    tau += load_columns(arm, q, v_ref, a_ref, gravity) @ load
    most = casadi.SX(robot.guard.tau_max)
    given = casadi.fmin(casadi.fmax(tau, -most), most)
    rest = memory[APPLIED + n : MEMORY_WORDS]
    return tau, casadi.vertcat(found.sums, found.theta, found.spread, given, rest)
