"""The compiled model against itself in plain Python: the same functions, run by the interpreter."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np

SCRIPT = """
import json
import numpy as np
from qrobot.config import load_robot
from qrobot.model.arm import Arm
from qrobot.model.dynamics import (
    dynamics_params, dynamics_work, friction_params, friction_torque, gravity_torque, inverse_dynamics
)
from qrobot.model.transmission import counts_to_joint, joint_to_counts, torque_to_dac, transmission_params

robot = load_robot("puma560")
arm, rigid, gears = Arm(robot), dynamics_params(robot), transmission_params(robot)
results = []
for q in np.random.default_rng(3).uniform(robot.limits.q_min, robot.limits.q_max, (20, 6)):
    tau, motor, back = np.empty(6), np.empty(6), np.empty(6)
    counts, dac = np.empty(6, dtype=np.int64), np.empty(6, dtype=np.int64)
    gravity_torque(q, rigid, dynamics_work(q.size), tau)
    results.append(tau.tolist())
    inverse_dynamics(q, 0.5 * q, -q, rigid, dynamics_work(6), tau)
    results.append(tau.tolist())
    torque_to_dac(tau, gears, motor, dac)
    joint_to_counts(q, gears, counts)
    counts_to_joint(counts, gears, back)
    friction_torque(0.01 * q, friction_params(robot), tau)
    results += [dac.tolist(), counts.tolist(), back.tolist(), tau.tolist()]
    T = arm.forward(q)
    results += [row.tolist() for row in T] + [row.tolist() for row in arm.jacobian(q)]
    results += [solution.tolist() for solution in arm.inverses(T, q).values()]
print(json.dumps(results))
"""


def run(disable_jit: str) -> list[list[float]]:
    environment = os.environ | {"NUMBA_DISABLE_JIT": disable_jit}
    output = subprocess.run([sys.executable, "-c", SCRIPT], env=environment, capture_output=True, check=True, text=True)
    results: list[list[float]] = json.loads(output.stdout)
    return results


def test_compiled_and_interpreted_model_agree() -> None:
    compiled, interpreted = run("0"), run("1")
    assert len(compiled) == len(interpreted) > 20 * 16
    for ours, oracle in zip(compiled, interpreted, strict=True):
        np.testing.assert_allclose(ours, oracle, rtol=1e-9, atol=1e-9)
