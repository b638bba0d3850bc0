"""Inputs on which a law is tried: the robot's poses, motions within its limits, and what only a fault would bring."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.hwif.registers import N_ADCS
from qrobot.servo.laws.law import ARGUMENTS, KP, KV, M0, MEMORY_WORDS, N_GAINS, Law
from qrobot.servo.memory.telemetry import N_PAYLOAD

OFFSET: Final = 1e-3  # rad or m, and rad/s or m/s, between reference and arm
STATES: Final = 24  # [A] random ones within the limits
SENSOR_VOLTS: Final = 5.0  # full scale of the board's converter
SEED: Final = 1
EXTREMES: Final = (np.nan, np.inf, -np.inf, 1e300, -1e300)
_GIVEN: Final = frozenset({"payload", "gains", "settings", "memory", "dt", "tau"})  # no measurement makes these extreme

Arguments = tuple[Floats, ...]


def at_pose(law: Law, robot: Robot, q: Floats) -> Arguments:
    """Arguments for the law of an arm near its reference, in the order of `law.ARGUMENTS`; no result yet."""
    n, control = robot.n, robot.control
    gains = np.zeros((N_GAINS, n))
    gains[KP], gains[KV], gains[M0] = control.kp, control.kv, control.inertia
    vectors = [q + OFFSET, np.full(n, OFFSET), np.zeros(n), np.array(q), np.zeros(n), np.zeros(n), np.zeros(n)]
    told = (np.zeros(N_ADCS), np.zeros(N_PAYLOAD), gains, law.values.copy())
    return (*vectors, *told, np.zeros(MEMORY_WORDS), np.array([1e-3]), np.full(n, np.nan))


def at_poses(law: Law, robot: Robot) -> Iterator[tuple[str, Arguments]]:
    """The arm at each pose of the robot file, by name: near its reference, and at it as when it is taken over."""
    for pose, q in robot.poses.items():
        yield f"at the pose {pose!r}", at_pose(law, robot, q)
        arguments = dict(zip(ARGUMENTS, at_pose(law, robot, q), strict=True))
        arguments["q_ref"][:], arguments["v_ref"][:] = q, 0.0
        yield f"at the pose {pose!r} without any error", tuple(arguments.values())


def in_motion(law: Law, robot: Robot) -> Iterator[Arguments]:
    """Random states within the robot's limits, the same ones every time; each goes on with the memory of the last."""
    rng, limits, memory = np.random.default_rng(SEED), robot.limits, np.zeros(MEMORY_WORDS)
    for _ in range(STATES):
        q = rng.uniform(limits.q_min, limits.q_max)
        arguments = dict(zip(ARGUMENTS, at_pose(law, robot, q), strict=True))
        arguments["v"][:], arguments["v_ref"][:] = rng.uniform(-limits.v_max, limits.v_max, (2, robot.n))
        arguments["a_ref"][:] = rng.uniform(-limits.a_max, limits.a_max)
        arguments["gravity"][:], arguments["friction"][:] = rng.uniform(-1, 1, (2, robot.n)) * robot.guard.tau_max
        arguments["sensors"][:] = rng.uniform(0.0, SENSOR_VOLTS, N_ADCS)
        arguments["memory"] = memory
        yield tuple(arguments.values())


def at_extremes(law: Law, robot: Robot) -> Iterator[tuple[str, Arguments]]:
    """Each measurement in turn, by name, as only a fault would make it: no number, or beyond everything."""
    for k, name in enumerate(ARGUMENTS):
        if name in _GIVEN:
            continue
        for value in EXTREMES:
            arguments = at_pose(law, robot, robot.poses["ready"])
            arguments[k][:] = value
            yield f"{name} = {value}", arguments
