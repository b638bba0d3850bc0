"""Damped Newton steps towards a pose, for any serial arm.

The damping is that of Sugihara (2011, "Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method"):
as large as the error that is left, so that it fades out on the way.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from qrobot.arrays import Floats
from qrobot.model.kinematics import KinematicsParams, forward, jacobian
from qrobot.model.solve import invert_into
from qrobot.realtime.jit import lean_kernel

LEFT_OVER: Final = 1e-11  # of the error, rad or arm lengths: then one more step makes it the rounding's
STEPS: Final = 80
_FLOOR: Final = 1e-13  # of the damping
_LARGEST_STEP: Final = 1.0  # rad or m
_NO_TURN: Final = 1e-12  # sine of a turn so small that its axis is the turn


class Scratch(NamedTuple):
    """Room for the steps.

    Attributes:
        now: pose. Shape (4, 4).
        J: Jacobian, then weighted. Shape (6, n).
        error: from the pose to the goal, weighted. Shape (6,).
        A, work, inverse: of the damped equations. Shape (6, 6).
    """

    now: Floats
    J: Floats
    error: Floats
    A: Floats
    work: Floats
    inverse: Floats


def scratch_for(n: int) -> Scratch:
    """Room for an arm of `n` joints."""
    square = np.empty((6, 6))
    return Scratch(np.empty((4, 4)), np.empty((6, n)), np.empty(6), square, square.copy(), square.copy())


@lean_kernel
def approach(T: Floats, p: KinematicsParams, per_length: float, bounded: bool, q: Floats, room: Scratch) -> bool:
    """Take steps from `q` (n,), in place, until the arm's pose is `T` (4, 4); False when they lead nowhere.

    Lengths count as `per_length` times as many radians. When `bounded`, no step leaves the joints' ranges.
    """
    for _ in range(STEPS):
        _look(T, p, per_length, q, room)
        largest = 0.0
        for value in room.error:
            largest = max(largest, abs(value))
        _step(q, room, 1.0 if largest < LEFT_OVER else _LARGEST_STEP)
        if largest < LEFT_OVER:
            return True
        if bounded:
            for j in range(q.size):
                q[j] = min(max(q[j], p.q_min[j]), p.q_max[j])
    return False


@lean_kernel
def _look(T: Floats, p: KinematicsParams, per_length: float, q: Floats, room: Scratch) -> None:
    """Fill in Jacobian and error at `q` (n,)."""
    now, J, error = room.now, room.J, room.error
    forward(q, p, now)
    jacobian(q, p, J)
    for i in range(3):
        error[i] = per_length * (T[i, 3] - now[i, 3])
        for j in range(q.size):
            J[i, j] *= per_length
    error[3], error[4], error[5] = _axis(T, now, 2, 1), _axis(T, now, 0, 2), _axis(T, now, 1, 0)
    sine = math.sqrt(error[3] * error[3] + error[4] * error[4] + error[5] * error[5])
    cosine = -0.5
    for i in range(3):
        cosine += 0.5 * _turned(T, now, i, i)
    if sine > _NO_TURN:
        for i in range(3, 6):
            error[i] *= math.atan2(sine, cosine) / sine
    elif cosine < 0.0:
        _half_turn(T, now, error)


@lean_kernel
def _half_turn(T: Floats, now: Floats, error: Floats) -> None:
    """Fill in the turn (entries 3 to 5 of `error`) when it is half a turn, whose axis no sine tells."""
    widest = 0
    for i in range(1, 3):
        if _turned(T, now, i, i) > _turned(T, now, widest, widest):
            widest = i
    length = math.sqrt(0.5 * (1.0 + _turned(T, now, widest, widest)))
    for i in range(3):
        product = 0.5 * (_turned(T, now, i, widest) + (1.0 if i == widest else 0.0))
        error[3 + i] = math.pi * product / length


@lean_kernel
def _turned(T: Floats, now: Floats, i: int, k: int) -> float:
    """Entry (i, k) of the rotation from `now` to `T`."""
    return float(T[i, 0] * now[k, 0] + T[i, 1] * now[k, 1] + T[i, 2] * now[k, 2])


@lean_kernel
def _axis(T: Floats, now: Floats, i: int, k: int) -> float:
    """A component of the rotation's axis, times the sine of its angle."""
    return 0.5 * (_turned(T, now, i, k) - _turned(T, now, k, i))


@lean_kernel
def _step(q: Floats, room: Scratch, largest: float) -> None:
    """One step of `q` (n,), shortened so that no joint takes more than `largest`: J' (J J' + damping)^-1 error."""
    J, error, A = room.J, room.error, room.A
    damping = _FLOOR
    for value in error:
        damping += 0.5 * value * value
    for i in range(6):
        for k in range(6):
            A[i, k] = damping if i == k else 0.0
            for j in range(q.size):
                A[i, k] += J[i, j] * J[k, j]
    invert_into(A, room.work, room.inverse)
    share, longest = 1.0, 0.0
    for passing in range(2):  # how long the step would be, then the step
        for j in range(q.size):
            step = 0.0
            for i in range(6):
                for k in range(6):
                    step += J[i, j] * room.inverse[i, k] * error[k]
            longest = max(longest, abs(step))
            if passing == 1:
                q[j] += share * step
        share = largest / max(largest, longest)
