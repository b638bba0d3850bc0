"""The original digital servo boards, for comparison."""

from __future__ import annotations

from typing import Any, Final

from qrobot.servo.laws.law import KP, KV, Setting, law

PERIOD, INTEGRAL_TIME, BAND, SHARE = range(4)  # settings
WAIT, INTEGRAL = 0, 1  # memory: time until the boards run again; an integral for each joint, then a torque

SETTINGS: Final = (
    Setting("period", 924e-6, 0.0, 0.02, "s", "a board's cycle (QRobot paper, section 2)"),
    Setting("integral_time", 0.1, 0.01, 10.0, "s", "of the integral of the error near a target"),
    Setting("band", 0.02, 0.0, 1.0, "rad", "error below which an axis that is to stand still is integrated"),
    Setting("share", 0.02, 0.0, 0.2, "rad", "error whose torque the integral reaches at most"),
)


@law(settings=SETTINGS)
def unimation(
    q_ref: Any, v_ref: Any, q: Any, v: Any, gains: Any, settings: Any, memory: Any, dt: Any, tau: Any
) -> None:
    """A model of the Unimation Mark II's digital servo boards: PD, an integral near the target, no model of the arm.

    Known are one processor a joint, a cycle of some 924 us beside setpoints every 28 ms, and 24-bit fixed point (QRobot
    paper, section 2); between two cycles the torque stays. The rest is our assumption: an integral that stands in for
    gravity and friction compensation and grows while an axis is to stand still; its bounds; the robot file's gains.
    """
    n = tau.size
    memory[WAIT] -= dt[0]
    if memory[WAIT] > 0.0:
        for j in range(n):
            tau[j] = memory[INTEGRAL + n + j]
        return
    elapsed = max(settings[PERIOD], dt[0])
    memory[WAIT] = max(memory[WAIT] + settings[PERIOD], 0.0)
    for j in range(n):
        error, at = q_ref[j] - q[j], INTEGRAL + j
        if v_ref[j] == 0.0 and abs(error) < settings[BAND]:
            grown = memory[at] + error * elapsed / settings[INTEGRAL_TIME]
            memory[at] = min(max(grown, -settings[SHARE]), settings[SHARE])
        tau[j] = gains[KP, j] * (error + memory[at]) + gains[KV, j] * (v_ref[j] - v[j])
        memory[INTEGRAL + n + j] = tau[j]
