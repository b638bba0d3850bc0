"""Computed torque (inverse dynamics control): the full rigid-body model makes every joint a double integrator."""

from __future__ import annotations

from typing import Any

from qrobot.servo.laws.casadi_law import casadi_law
from qrobot.servo.laws.law import KP, KV, M0


@casadi_law
def computed_torque(
    robot: Any, arm: Any, q_ref: Any, v_ref: Any, a_ref: Any, q: Any, v: Any, friction: Any, payload: Any, gains: Any
) -> Any:
    """Computed torque (Luh, Walker and Paul 1980): feedback asks for accelerations, the model turns them into torques.

    tau = M(q) (a_ref + Kv/M0 (v_ref - v) + Kp/M0 (q_ref - q)) + c(q, v) + g(q) + friction(v_ref)

    M, c and g are those of the arm with its payload.

    Gravity is compensated on every joint, whatever the robot file says of it. With the gains of the other laws the
    poles are theirs, at every pose and not only where the inertia happens to be M0.
    """
    from qrobot.codegen.load import payload_torque  # loads CasADi
    from qrobot.codegen.rigid_body import inverse_dynamics

    kp, kv, m0 = (gains[row, :].T for row in (KP, KV, M0))
    acceleration = a_ref + (kv * (v_ref - v) + kp * (q_ref - q)) / m0
    gravity = robot.geometry.gravity_m_s2
    tau = inverse_dynamics(arm, q, v, acceleration, gravity) + friction
    return tau + payload_torque(arm, q, v, acceleration, gravity, payload)
