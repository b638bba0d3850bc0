"""The safety gate, motors: what a joint does that neither its command nor its model explains, and what to call it.

One observation serves all of it, the torque nobody commanded (`servo.checks.momentum_observer`); the symptom beside it
gives the name:

| the joint                                                         | code        |
|-------------------------------------------------------------------|-------------|
| shows no count although it was fast, or is driven                 | ENC_STUCK   |
| accelerates backwards as hard as it is driven, or turned at once; |             |
| it has never gone the way of its torque since power came on       | ENC_SIGN    |
| is faster than its reference, driven by what nobody commanded;    |             |
| that has not taken more energy from the arm than it gives         | RUNAWAY     |
| anything else                                                     | COLLISION   |
| that, and a controlled stop does not end it                       | DAC_STUCK   |

A joint that shows no count at all is watched by `servo.checks.dead_encoder` too, sooner and beside its potentiometer.

A passive obstacle gives back no more energy than it took. It can throw one joint about with what it takes from another
- an arm that comes down on a table turns its wrist -, but all pushes together take energy from the arm; that tells
COLLISION from RUNAWAY. Signs are wired while power is off: a motor that has gone the way of its torque for a quarter of
a turn since has the right one, and what goes against its torque afterwards has hit something.

What cannot be told apart: a jammed joint from a dead encoder, a body that keeps pushing or holding the arm from an
amplifier that does not obey. The name with the harder stop is taken then.

As in `servo.checks.limit_checks`: every check answers with a fault code, 0 for all well, and is written `not (x <=
limit)`.
"""

from __future__ import annotations

from typing import Any, Final

from qrobot.faultcodes import NO_JOINT, FaultCode
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.kernels.velocity import at_rest

NONE: Final = int(FaultCode.NONE)
ENC_STUCK: Final = int(FaultCode.ENC_STUCK)
ENC_SIGN: Final = int(FaultCode.ENC_SIGN)
DAC_STUCK: Final = int(FaultCode.DAC_STUCK)
RUNAWAY: Final = int(FaultCode.RUNAWAY)
BRAKE_SLIP: Final = int(FaultCode.BRAKE_SLIP)
SATURATED: Final = int(FaultCode.SATURATED)
COLLISION: Final = int(FaultCode.COLLISION)

NOTICE_S: Final = 0.003  # so long a push has to last: a velocity estimate that stumbles over a late image is none
MOVING_PUSH_S: Final = 0.04  # a joint still moved by a push after so long: the stop does not take
STANDING_PUSH_S: Final = 0.3  # longer than a controlled stop: by then the reference has given way
STANDSTILL: Final = 0.05  # rad/s or m/s
FROZEN_S: Final = 0.015  # without a count so long while pushed: counting nothing
SUSPECT_COUNTS: Final = 4.0  # so many counts overdue: judge when it is clear whether more will come
OVERDUE_COUNTS: Final = 12.0
OVERDUE_S: Final = 0.002
# Push over the driving torque when it acts the wrong way round: 2, but for what the model misses. It does so from the
# first moment on; where it comes to that later, the law has answered a push with a torque as large.
SIGN_LEAST: Final = 1.5
SIGN_MOST: Final = 2.5
SIGN_S: Final = 0.0045
TURNED_S: Final = 0.008  # after a push beyond all torque: by then the velocity shows whether the counts run backwards
SIGN_DRIVE: Final = 0.3  # of the threshold: with less torque there is no telling
FELT_SHARE: Final = 0.5  # of the threshold: smaller pushes may be the model's: no work, nothing in the way [A]
BRAKED_SHARE: Final = 0.875  # of its estimated velocity: a joint that has counted less, by more than one, brakes [A]
WORK_S: Final = 0.025  # in which work is forgotten: longer than a blow [A]


@lean_kernel
def counted_speed(v: float, v_before: float, step: int, before: int, speed_of_count: float) -> float:
    """Estimated velocity `v`, but no faster than the newest two samples have counted, `step` and `before`.

    The estimate lags behind a joint that a blow stops within milliseconds; its counts do not, and become fewer. Of an
    encoder that dies only the newest sample is a part of one. Where the one before was slower already than `v`, or than
    `v_before` as it was then, the joint brakes.
    """
    braked = (abs(before) + 1) * speed_of_count < BRAKED_SHARE * max(abs(v), abs(v_before))
    most = (abs(step) if braked else max(abs(step), abs(before))) * speed_of_count
    return min(max(v, -most), most)


@lean_kernel
def stopped_dead(
    still_s: float, v_moving: float, unit_per_count: float, inertia: float, impossible: float, over_s: float
) -> bool:
    """A motor that moved at `v_moving` shows no count for `still_s`: long enough for many, too short to have stopped.

    Such a stop takes a torque above `impossible`, N m (N). A push that has been above its threshold for `over_s`, since
    before the last count, was seen by an encoder that lives: the estimate of velocity lags behind such a stop.
    """
    speed = abs(v_moving)
    if over_s > still_s:
        return False
    if still_s < OVERDUE_S or still_s * speed < OVERDUE_COUNTS * unit_per_count:
        return False
    return inertia * speed > impossible * still_s


@lean_kernel
def acts_backwards(push: float, drive: float, v: float, limit: float) -> bool:
    """The joint goes against `drive`, the torque beyond load and friction, as hard as it should go with it.

    Then `push` is twice that torque, the other way round.
    """
    size = abs(drive)
    if size < SIGN_DRIVE * limit or push * drive > 0.0 or v * drive >= 0.0:
        return False
    return SIGN_LEAST * size <= abs(push) <= SIGN_MOST * size


@lean_kernel
def turned_round(v: float, v_ref: float) -> bool:
    """The joint is seen to move against its reference."""
    return v * v_ref < 0.0 and abs(v) > STANDSTILL


@lean_kernel
def outruns(push: float, v: float, v_ref: float, margin: float) -> bool:
    """The push drives the joint faster than its reference, by more than `margin`."""
    return push * v > 0.0 and not abs(v) <= abs(v_ref) + margin


@lean_kernel
def counts_along(along: int, step: int, torque: float, enough: float) -> int:
    """Counts a motor has gone along its `torque`, less those it went against it, after `step` more of them.

    Never below 0; once there are `enough` it stays at that.
    """
    if along >= enough:
        return along
    return max(0, along + abs(step) if step * torque > 0.0 else along - abs(step))


@lean_kernel
def power_given(push: float, v: float, limit: float) -> float:
    """Power a push gives its joint, W, 0 where the model may be what is wrong."""
    return 0.0 if abs(push) <= FELT_SHARE * limit else push * v


@lean_kernel
def recent_work(work: float, power: float, dt: float) -> float:
    """Work of the pushes of late, J, after `dt` seconds at `power`; forgotten with WORK_S."""
    return at_rest(work + dt * power - work * min(1.0, dt / WORK_S))


@lean_kernel
def check_push(
    push: float, limit: float, over_s: float, drive: float, v: float, v_ref: float, margin: float,
    still_s: float, overdue: float, impossible: float, taken: bool, proven: bool,
) -> int:  # fmt: skip
    """Code of one joint's symptom, see the table above.

    Args:
        push: torque nobody commanded. limit: its threshold. over_s: for how long it has been above.
        drive: torque beyond load and friction. v, v_ref: measured and desired velocity. margin: see `outruns`.
        still_s: time without a count. overdue: counts that should have come meanwhile.
        impossible: more torque than there is. taken: all pushes together have taken energy from the arm of late.
        proven: its motor has gone the way of its torque.
    """
    if abs(push) <= limit:
        return NONE
    if still_s >= FROZEN_S:
        return ENC_STUCK
    if outruns(push, v, v_ref, margin) and not taken:
        return RUNAWAY
    if over_s < NOTICE_S or overdue >= SUSPECT_COUNTS:
        return NONE
    return name_push(push, limit, over_s, drive, v, v_ref, impossible, taken or proven)


@lean_kernel
def name_push(
    push: float, limit: float, over_s: float, drive: float, v: float, v_ref: float, impossible: float, signed: bool
) -> int:  # fmt: skip
    """Code of a push that has lasted, on a joint that counts and does not run away; see `check_push`.

    signed: it is not its sign that is wrong.
    """
    if not signed and over_s < SIGN_S and acts_backwards(push, drive, v, limit):
        return ENC_SIGN
    if not signed and abs(push) > impossible and over_s < TURNED_S:
        return ENC_SIGN if turned_round(v, v_ref) else NONE
    if over_s < (MOVING_PUSH_S if abs(v) > STANDSTILL else STANDING_PUSH_S):
        return COLLISION
    return DAC_STUCK


@lean_kernel
def check_saturation(clipped_s: float, longest_s: float) -> int:
    """A torque does not stay at its limit for longer than `longest_s`."""
    return NONE if clipped_s <= longest_s else SATURATED


@lean_kernel
def check_parked(q: Any, q_parked: Any, braked: Any, slip: Any) -> tuple[int, int]:
    """(code, joint): without power, joints with brakes stay where they came to rest, within `slip`. Shapes (n,)."""
    for j in range(q.size):
        if braked[j] != 0 and not abs(q[j] - q_parked[j]) <= slip[j]:
            return BRAKE_SLIP, j
    return NONE, NO_JOINT
