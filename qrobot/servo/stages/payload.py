"""The payload that the model reckons with: taken from the commander, and gone over to without a bump.

The model is linear in ten numbers of a body, its mass, first moments and inertia about the origin of the last frame
(Khalil and Dombre 2002, chapter 9). They go from those before to those asked for along 3 s^2 - 2 s^3 within `RAMP_S`,
so that gravity, and with it the torque of a law, changes smoothly also while the arm moves. Whether the arm can carry
it is judged by whoever asks (`model.payload_judge`); here only numbers are refused that would spoil the model.
"""

from __future__ import annotations

from typing import Any, Final

from qrobot.realtime.atomics import load_acquire
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.state import ServoState

RAMP_S: Final = 0.5  # [A] longer than the slowest law's answer, shorter than a hand takes to lift
MOST_NUMBER: Final = 1e4  # kg, kg m, kg m^2: beyond any load


@lean_kernel
def carry_payload(params: ServoParameters, state: ServoState, mail: Any) -> None:
    """Take a payload that is new, and go on to the one asked for."""
    asked = load_acquire(mail.command, "payloads")
    if asked != state.payloads_seen:
        state.payloads_seen = asked
        if body_of(mail.command, params.flange_m, state.payload_next):
            for k in range(state.payload.size):
                state.payload_before[k], state.payload_goal[k] = state.payload[k], state.payload_next[k]
            state.payload_left_s = RAMP_S
    if state.payload_left_s > 0.0:
        go_over(state)
        hang_on(params, state)


@lean_kernel
def body_of(command: Any, flange_m: float, body: Any) -> bool:
    """Ten numbers of the commander's payload in the last frame, into `body`; False when they are none of a body."""
    mass, inertia = command.payload_mass, command.payload_inertia
    x, y, z = command.payload_centre[0], command.payload_centre[1], command.payload_centre[2] + flange_m
    body[0], body[1], body[2], body[3] = mass, mass * x, mass * y, mass * z
    body[4] = inertia[0] + mass * (y * y + z * z)
    body[5] = inertia[1] + mass * (x * x + z * z)
    body[6] = inertia[2] + mass * (x * x + y * y)
    body[7] = inertia[3] - mass * x * y
    body[8] = inertia[4] - mass * x * z
    body[9] = inertia[5] - mass * y * z
    sane = mass >= 0.0
    for k in range(body.size):
        sane = sane and abs(body[k]) <= MOST_NUMBER  # not so for NaN
    return bool(sane)


@lean_kernel
def go_over(state: ServoState) -> None:
    """Advance the payload in force by one cycle."""
    state.payload_left_s = max(0.0, state.payload_left_s - state.dt)
    done = 1.0 - state.payload_left_s / RAMP_S
    share = done * done * (3.0 - 2.0 * done)
    for k in range(state.payload.size):
        before, goal = state.payload_before[k], state.payload_goal[k]
        state.payload[k] = goal if state.payload_left_s == 0.0 else before + share * (goal - before)
    state.payload_mass = state.payload[0]


@lean_kernel
def hang_on(params: ServoParameters, state: ServoState) -> None:
    """Put the payload in force on the last link of the model."""
    last = params.dynamics.mass.size - 1
    bare, model, payload = params.dynamics, state.model, state.payload
    model.mass[last] = bare.mass[last] + payload[0]
    for k in range(3):
        model.moment[last, k] = bare.moment[last, k] + payload[1 + k]
    for k in range(6):
        model.inertia[last, k] = bare.inertia[last, k] + payload[4 + k]
