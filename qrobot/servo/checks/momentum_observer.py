"""The torque on each joint that nobody commanded, from what the joint does with the torque it is given.

A momentum observer (De Luca and Mattone, "Actuator failure detection and isolation using generalized momenta", 2003)
on each joint by itself, with the constant inertia M0 of the robot file:

    push = pace (M0 v - expected)        d expected / dt = tau - load - friction + push

so that `push` follows the missing torque with the time constant 1/pace, and needs no acceleration. Where v comes out of
a low pass, the torque has to go through the same one, or every change of it shows as push. Rotors that other joints
turn too belong to the momentum: off the diagonal, M0 is C^T J C. What the constant inertia leaves out - other links'
accelerations, centrifugal torque, a load in the hand, wrong friction and a wrong torque constant - shows as push as
well; the thresholds have to lie above it.
"""

from __future__ import annotations

from typing import Final

from qrobot.realtime.jit import lean_kernel

STALE: Final = 0.75  # time constants without a sample or a cycle after which the observer begins anew


@lean_kernel
def observe_push(
    momentum: float, drive: float, dt: float, pace: float, expected: float, push: float
) -> tuple[float, float]:
    """(expected, push) of one joint, carried on by `dt` seconds.

    Args:
        momentum: M0 v, measured now, N m s (N s).
        drive: torque during `dt` beyond load and friction, as late as v, N m (N).
        pace: of the observer, 1/s.
        expected, push: as they were.
    """
    expected += dt * (drive + push)
    return expected, pace * (momentum - expected)
