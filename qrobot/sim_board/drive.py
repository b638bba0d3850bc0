"""Amplifiers, motors, friction and brakes: from DAC words to joint torques.

Everything is on the motor side in joint units: r = C (q - q_offset), torque tau_joint = C^T tau_motor, C the coupling
of the wrist. An amplifier gives (n - 2048) / dac_per_Nm while arm power is on, and nothing otherwise.

Friction is a Prandtl element with a Stribeck limit: a stiff bristle that carries the load while the joint sticks and
slides at its limit otherwise. Unlike LuGre's it yields nothing below the limit, so an arm held by stiction does not
creep (Dupont et al. 2002 on drift-free friction). With s the stiction factor and v_s the Stribeck velocity:

    limit(v) = coulomb * (1 + (s - 1) / (1 + (v / v_s)^2)) + brake     per direction; Hess and Soom 1990 for the shape
    y       <- clip(y + k v dt, -limit_neg, limit_pos)                 load of the bristle
    tau_f    = clip(y + d / k dy/dt, -limit_neg, limit_pos) + viscous v

k is no measured stiffness: it is the largest that stays well inside stability at the plant's step,
sqrt(k / armature) dt = 1/2 (on the smallest inertia a motor can see, its own rotor). For the PUMA at
4 kHz a joint at its friction limit is bent by a tenth of a count.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import ConfigError
from qrobot.hwif.registers import DAC_ZERO
from qrobot.realtime.jit import lean_kernel
from qrobot.sim_board.mismatch import PlantMismatch

STRIBECK_FRACTION: Final = 0.02  # [A] Stribeck velocity over the joint's maximum speed
BRAKE_FACTOR: Final = 3.0  # [A] holding torque of a brake over the motor's full-scale torque
_BRISTLE_ANGLE: Final = 0.5  # sqrt(k / inertia) dt, rad per step; stable below 2 without damping
_BRISTLE_DAMPING: Final = 0.7  # of the critical one


class JointDrives(NamedTuple):
    """Parameters and state of all joints' drives; arrays float64[n] in joint units (N.m, rad or N, m)."""

    torque_per_count: Floats  # signed
    viscous: Floats
    coulomb_pos: Floats  # opposes positive motion
    coulomb_neg: Floats  # opposes negative motion, positive number
    stribeck_slowness: Floats  # 1 / v_s
    stiffness_dt: Floats  # k dt
    damping_share: Floats  # d / (k dt)
    brake: Floats  # added to the friction limit by a closed brake; 0 for joints without
    coupling: Floats  # [n, n], C
    load: Floats  # state y
    tau_motor: Floats  # last motor torque less friction
    stiction: float


def make_drive(robot: Robot, mismatch: PlantMismatch, friction: str, dt: float) -> JointDrives:
    """Drives of `robot` with one of its friction presets. Raises ConfigError when the robot has no such preset."""
    if friction not in robot.friction:
        raise ConfigError(f"{robot.name} has no friction preset {friction!r}, only {', '.join(robot.friction)}")
    preset, transmission, n = robot.friction[friction], robot.transmission, robot.n
    armature = transmission.gear**2 * transmission.rotor_inertia
    full_scale = DAC_ZERO / np.abs(transmission.dac_per_Nm)
    stiffness = armature * (_BRISTLE_ANGLE / dt) ** 2
    damping = 2.0 * _BRISTLE_DAMPING * np.sqrt(stiffness * armature)
    return JointDrives(
        torque_per_count=mismatch.torque_gain / transmission.dac_per_Nm,
        viscous=preset.viscous * mismatch.viscous,
        coulomb_pos=preset.coulomb_pos * mismatch.coulomb_pos,
        coulomb_neg=preset.coulomb_neg * mismatch.coulomb_neg,
        stribeck_slowness=1.0 / (STRIBECK_FRACTION * robot.limits.v_max),
        stiffness_dt=stiffness * dt,
        damping_share=damping / (stiffness * dt),
        brake=np.where(transmission.brake, BRAKE_FACTOR * full_scale, 0.0),
        coupling=np.array(transmission.coupling),
        load=np.zeros(n),
        tau_motor=np.zeros(n),
        stiction=mismatch.stiction,
    )


@lean_kernel
def friction_torque(drive: JointDrives, joint: int, velocity: float, braked: float) -> float:
    """Torque friction takes from a motor at `velocity`, N.m in joint units; advances the bristle by one step.

    `braked` is the share of its holding torque the joint's brake has now, 0 when it is open.
    """
    slowness = velocity * drive.stribeck_slowness[joint]
    rise = 1.0 + (drive.stiction - 1.0) / (1.0 + slowness * slowness)
    brake = braked * drive.brake[joint]
    upper = drive.coulomb_pos[joint] * rise + brake
    lower = -drive.coulomb_neg[joint] * rise - brake
    before = drive.load[joint]
    load = min(max(before + velocity * drive.stiffness_dt[joint], lower), upper)
    drive.load[joint] = load
    rubbing = load + drive.damping_share[joint] * (load - before)
    return float(min(max(rubbing, lower), upper) + drive.viscous[joint] * velocity)


@lean_kernel
def drive_torque(
    drive: JointDrives, dac: NDArray[np.int64], powered: bool, braked: Floats, velocity: Floats, tau_joint: Floats
) -> None:
    """Joint torques of one step: amplifiers less friction, seen through the coupling.

    Args:
        drive: the drives, whose bristles advance by one step.
        dac: int64[>= n] DAC words.
        powered: amplifiers are on.
        braked: float64[>= n] share of its holding torque each brake adds to friction.
        velocity: float64[n] joint velocities.
        tau_joint: float64[n] torques on the joints (out).
    """
    n, coupling = drive.viscous.size, drive.coupling
    for i in range(n):
        motor_velocity = 0.0
        for j in range(n):
            motor_velocity += coupling[i, j] * velocity[j]
        amplifier = (dac[i] - DAC_ZERO) * drive.torque_per_count[i] if powered else 0.0
        drive.tau_motor[i] = amplifier - friction_torque(drive, i, motor_velocity, braked[i])
    for j in range(n):
        total = 0.0
        for i in range(n):
            total += coupling[i, j] * drive.tau_motor[i]
        tau_joint[j] = total
