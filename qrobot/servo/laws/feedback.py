"""Laws of joints on their own: PD feedback, QRobot's with friction and gravity, and the same with feed-forward."""

from __future__ import annotations

from typing import Any

from qrobot.servo.laws.law import KP, KV, M0, law


@law
def pd(q_ref: Any, v_ref: Any, q: Any, v: Any, gains: Any, tau: Any) -> None:
    """Proportional and derivative feedback alone: tau = Kp (q_ref - q) + Kv (v_ref - v)."""
    for j in range(tau.size):
        tau[j] = gains[KP, j] * (q_ref[j] - q[j]) + gains[KV, j] * (v_ref[j] - v[j])


@law
def qrobot(q_ref: Any, v_ref: Any, q: Any, v: Any, gravity: Any, friction: Any, gains: Any, tau: Any) -> None:
    """QRobot's law (QRobot paper, section 6): PD, friction compensation on all joints, gravity on joints 2 and 3.

    tau = Kp (q_ref - q) + Kv (v_ref - v) + friction(v_ref) + gravity(q)
    """
    for j in range(tau.size):
        feedback = gains[KP, j] * (q_ref[j] - q[j]) + gains[KV, j] * (v_ref[j] - v[j])
        tau[j] = feedback + friction[j] + gravity[j]


@law
def qrobot_acceleration(
    q_ref: Any, v_ref: Any, a_ref: Any, q: Any, v: Any, gravity: Any, friction: Any, gains: Any, tau: Any
) -> None:
    """QRobot's law with acceleration feed-forward of a constant inertia: ... + M0 a_ref."""
    for j in range(tau.size):
        feedback = gains[KP, j] * (q_ref[j] - q[j]) + gains[KV, j] * (v_ref[j] - v[j])
        tau[j] = feedback + friction[j] + gravity[j] + gains[M0, j] * a_ref[j]
