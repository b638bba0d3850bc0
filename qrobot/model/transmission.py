"""Transmission between counters and joints, joint torques and DAC codes: gears, wrist coupling, words and offsets.

Motor displacements r are counted in joint units (rad or m) from encoder zero, and are coupled in the wrist:

    r = C (q - q_offset)        counts = r / rad_per_count + count_offset        tau_motor = C^-T tau

so that power is the same on both sides. C is the inverse of the board vendor's form q6 = r6 - k46 r4 - k56 r5, which
takes the raw r5 (TRC004 driver v4.2). The vendor ignores C^-T: 20 N·m on joint 6 then puts 3.6 N·m on joint 5.

Kernels work on plain arrays of n entries and allocate nothing.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from qrobot.arrays import Floats, Ints
from qrobot.config.robot import Robot
from qrobot.realtime.jit import lean_kernel

DAC_ZERO: Final = 0x800  # 12-bit offset binary: 0 V, no torque [V]
DAC_MAX: Final = 0xFFF
WORD: Final = 0x10000  # counters are 16 bits wide


class TransmissionParams(NamedTuple):
    """Parameters of a robot's transmission for the kernels, n joints.

    Attributes:
        joint_per_count: C^-1 diag(rad_per_count). Shape (n, n).
        count_per_joint: its inverse. Shape (n, n).
        joint_per_motor: C^-1. Shape (n, n).
        motor_per_joint: C. Shape (n, n).
        rad_per_count: signed joint units of motor displacement per count. Shape (n,).
        q_offset: joint position at encoder zero. Shape (n,).
        count_offset: what the host adds to a counter. Shape (n,).
        counts_per_rev: counts per motor turn. Shape (n,).
        dac_per_Nm: DAC counts per N·m (or N) of motor torque in joint units. Shape (n,).
        pot_at_zero: potentiometer in ADC units of 20 V/65536 at encoder zero. Shape (n,).
        pot_per_count: ADC units per count. Shape (n,).
    """

    joint_per_count: Floats
    count_per_joint: Floats
    joint_per_motor: Floats
    motor_per_joint: Floats
    rad_per_count: Floats
    q_offset: Floats
    count_offset: Ints
    counts_per_rev: Ints
    dac_per_Nm: Floats  # noqa: N815 (newton-metre)
    pot_at_zero: Floats
    pot_per_count: Floats


def transmission_params(robot: Robot) -> TransmissionParams:
    """Collect the transmission of `robot` for the kernels; fresh, writable arrays of one Numba type."""
    t = robot.transmission
    joint_per_motor: Floats = np.linalg.inv(t.coupling).astype(np.float64)
    return TransmissionParams(
        joint_per_count=joint_per_motor * t.rad_per_count,
        count_per_joint=t.coupling / t.rad_per_count[:, None],
        joint_per_motor=joint_per_motor,
        motor_per_joint=np.array(t.coupling),
        rad_per_count=np.array(t.rad_per_count),
        q_offset=np.array(t.q_offset),
        count_offset=np.array(t.count_offset),
        counts_per_rev=np.array(t.counts_per_rev),
        dac_per_Nm=np.array(t.dac_per_Nm),
        pot_at_zero=np.array(t.pot_at_zero),
        pot_per_count=t.pots_per_rev / t.counts_per_rev,
    )


@lean_kernel
def counts_to_joint(counts: Ints, p: TransmissionParams, q: Floats) -> None:
    """Joint positions from counters as read, offset included. Shapes (n,)."""
    for j in range(q.size):
        position = p.q_offset[j]
        for i in range(q.size):
            position += p.joint_per_count[j, i] * (counts[i] - p.count_offset[i])
        q[j] = position


@lean_kernel
def joint_to_counts(q: Floats, p: TransmissionParams, counts: Ints) -> None:
    """Nearest counters for joint positions, offset included; the inverse of `counts_to_joint`. Shapes (n,)."""
    for i in range(q.size):
        turned = 0.0
        for j in range(q.size):
            turned += p.count_per_joint[i, j] * (q[j] - p.q_offset[j])
        counts[i] = math.floor(turned + 0.5) + p.count_offset[i]


@lean_kernel
def joint_to_motor(q: Floats, p: TransmissionParams, r: Floats) -> None:
    """Motor displacements r = C (q - q_offset) in joint units. Shapes (n,)."""
    for i in range(q.size):
        turned = 0.0
        for j in range(q.size):
            turned += p.motor_per_joint[i, j] * (q[j] - p.q_offset[j])
        r[i] = turned


@lean_kernel
def signed_word(word: int) -> int:
    """A 16-bit register word as the signed number it stands for."""
    word = word & (WORD - 1)
    return word - WORD if word >= WORD // 2 else word


@lean_kernel
def count_word(counts: int) -> int:
    """The 16-bit word that a counter shows at `counts`."""
    return counts & (WORD - 1)


@lean_kernel
def unwrap_counts(words: Ints, raw: Ints, counts: Ints, jump_counts: Ints, ahead: Ints) -> int:
    """Carry the positions `counts` on by the difference of the new `words` to the last accepted ones, `raw`.

    A joint whose word differs by more than `jump_counts` from where it is expected, `ahead` of its position, keeps its
    old word and position, so that a single bad reading passes without trace. Shapes (n,).

    Returns:
        The first joint held back, or -1.
    """
    held = -1
    for j in range(words.size):
        delta = signed_word(words[j] - raw[j])
        if abs(delta - ahead[j]) <= jump_counts[j]:
            raw[j] = words[j]
            counts[j] += delta
        elif held < 0:
            held = j
    return held


@lean_kernel
def dac_code(tau_motor: float, dac_per_Nm: float) -> int:
    """`trunc(tau scale) + 0x800`, clamped to 0..0xFFF (TRC004 driver v4.3); NaN asks for no torque."""
    steps = tau_motor * dac_per_Nm
    if math.isnan(steps):
        return DAC_ZERO
    if steps >= DAC_MAX - DAC_ZERO:
        return DAC_MAX
    if steps <= -DAC_ZERO:
        return 0
    return int(steps) + DAC_ZERO


@lean_kernel
def motor_rates(v: Floats, p: TransmissionParams, r_dot: Floats) -> None:
    """Motor speeds C v in joint units: friction acts where the motors are, not where the joints are. Shapes (n,)."""
    for i in range(v.size):
        speed = 0.0
        for j in range(v.size):
            speed += p.motor_per_joint[i, j] * v[j]
        r_dot[i] = speed


@lean_kernel
def torque_to_motor(tau: Floats, p: TransmissionParams, tau_motor: Floats) -> None:
    """Motor torques C^-T tau, in joint units. Shapes (n,)."""
    for i in range(tau.size):
        torque = 0.0
        for j in range(tau.size):
            torque += p.joint_per_motor[j, i] * tau[j]
        tau_motor[i] = torque


@lean_kernel
def motor_to_torque(tau_motor: Floats, p: TransmissionParams, tau: Floats) -> None:
    """Joint torques C^T tau_motor. Shapes (n,)."""
    for j in range(tau.size):
        torque = 0.0
        for i in range(tau.size):
            torque += p.motor_per_joint[i, j] * tau_motor[i]
        tau[j] = torque


@lean_kernel
def torque_to_dac(tau: Floats, p: TransmissionParams, tau_motor: Floats, dac: Ints) -> None:
    """DAC codes for joint torques; leaves the motor torques in `tau_motor`. Shapes (n,)."""
    torque_to_motor(tau, p, tau_motor)
    for i in range(tau.size):
        dac[i] = dac_code(tau_motor[i], p.dac_per_Nm[i])


@lean_kernel
def dac_to_motor_torque(dac: Ints, p: TransmissionParams, tau_motor: Floats) -> None:
    """Motor torques that DAC codes ask for, (n - 0x800) / dac_per_Nm. Shapes (n,)."""
    for i in range(dac.size):
        tau_motor[i] = (dac[i] - DAC_ZERO) / p.dac_per_Nm[i]


@lean_kernel
def motor_to_pot(r: Floats, p: TransmissionParams, pot: Floats) -> None:
    """Potentiometers in ADC units of 20 V/65536 for motor displacements r: straight, without waviness. Shapes (n,)."""
    for i in range(r.size):
        pot[i] = p.pot_at_zero[i] + p.pot_per_count[i] * r[i] / p.rad_per_count[i]
