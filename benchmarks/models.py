"""Rows 4 and 4b: inverse dynamics and one step of the plant, against MuJoCo's own functions in the same loop."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import casadi
import numpy as np

from benchmarks.rows import Goal, Row, against
from benchmarks.timing import Effort, interleaved
from qrobot.codegen import QUICK_EXPRESSIONS, compile_function, rigid_body
from qrobot.config import Robot, load_robot
from qrobot.model.dynamics import dynamics_params, dynamics_work, inverse_dynamics
from qrobot.realtime.flat_record import record_of
from qrobot.realtime.jit import lean_kernel
from qrobot.sim_board.mujoco_library import mj_com_pos, mj_com_vel, mj_kinematics, mj_rne, mj_step
from qrobot.sim_board.mujoco_plant import PlantMemory, load_plant
from qrobot.sim_board.plant import Plant, step_plant
from qrobot.sim_board.rigid_plant import RigidPlant

CALLS: Final = 200_000
DT: Final = 0.00025
MOTION: Final = 1e-7  # rad between calls, so that none can be left out


@lean_kernel
def recursive(q: Any, v: Any, a: Any, params: Any, work: Any, tau: Any, n: int) -> None:
    """`n` inverse dynamics by the recursion of `model.dynamics`."""
    for _ in range(n):
        q[0] += MOTION
        inverse_dynamics(q, v, a, params, work, tau)


@lean_kernel
def mujoco_recursion(model: int, data: int, q: Any, force: int, n: int) -> None:
    """`n` inverse dynamics by MuJoCo's recursion, with the kinematics it needs."""
    for _ in range(n):
        q[0] += MOTION
        mj_kinematics(model, data)
        mj_com_pos(model, data)
        mj_com_vel(model, data)
        mj_rne(model, data, 1, force)


@lean_kernel
def plant_steps(plant: Plant, n: int) -> None:
    """`n` steps of a plant at rest under no torque."""
    for _ in range(n):
        plant.v[:] = 0.0
        step_plant(plant)


@lean_kernel
def mujoco_steps(model: int, data: int, v: Any, n: int) -> None:
    """`n` steps of MuJoCo as it comes."""
    for _ in range(n):
        v[:] = 0.0
        mj_step(model, data)


def rows(effort: Effort) -> Iterator[Row]:
    """The rows."""
    robot = load_robot("puma560")
    memory = load_plant(robot, DT)
    memory.place(robot.poses["ready"])
    yield from inverse_rows(robot, memory, effort)
    yield from step_rows(robot, memory, effort)


def inverse_rows(robot: Robot, memory: PlantMemory, effort: Effort) -> Iterator[Row]:
    """Inverse dynamics of the PUMA: our recursion, and the expression translated to a kernel."""
    n, many = robot.n, effort.times(CALLS)
    q, v, a, tau = robot.poses["ready"].copy(), np.full(n, 0.3), np.full(n, 0.5), np.zeros(n)
    params, work = record_of(dynamics_params(robot)), dynamics_work(n)
    expression = _expression_calls(robot)
    model, data = memory.model._address, memory.data._address
    memory.data.qvel[:], memory.data.qacc[:] = v, a
    work_of = {
        "recursion": lambda k: recursive(q, v, a, params, work, tau, k),
        "expression": lambda k: expression(q, v, a, tau, k),
        "MuJoCo": lambda k: mujoco_recursion(model, data, memory.data.qpos, tau.ctypes.data, k),
    }
    times = _per_call_ns(work_of, many, effort)
    yield against("inverse dynamics, recursion", times["recursion"], "ns", "MuJoCo", times["MuJoCo"])
    goal = Goal(100.0)
    yield against("inverse dynamics, expression compiled", times["expression"], "ns", "MuJoCo", times["MuJoCo"], goal)


def _expression_calls(robot: Robot) -> Any:
    """A kernel of (q, v, a, tau, n) that evaluates the CasADi expression n times."""
    q, v, a = (casadi.SX.sym(name, robot.n) for name in ("q", "v", "a"))
    gravity = casadi.SX(robot.geometry.gravity_m_s2)
    torque = rigid_body.inverse_dynamics(rigid_body.serial_arm(robot), q, v, a, gravity)
    function = casadi.Function("bench_rne", [q, v, a], [casadi.cse(torque)], ["q", "v", "a"], ["tau"])
    evaluate = compile_function(function, expressions=QUICK_EXPRESSIONS).kernel

    @lean_kernel
    def calls(q: Any, v: Any, a: Any, tau: Any, n: int) -> None:
        for _ in range(n):
            q[0] += MOTION
            evaluate(q, v, a, tau)

    return calls


def step_rows(robot: Robot, memory: PlantMemory, effort: Effort) -> Iterator[Row]:
    """One step of the plant: the rigid one, and MuJoCo's pieces, against `mj_step`."""
    many, rigid, free = effort.times(CALLS), RigidPlant(robot, DT), memory.plant
    rigid.place(robot.poses["ready"])
    model, data = memory.model._address, memory.data._address
    work_of = {
        "rigid": lambda k: plant_steps(rigid.plant, k),
        "pieces": lambda k: plant_steps(free, k),
        "MuJoCo": lambda k: mujoco_steps(model, data, memory.data.qvel, k),
    }
    times = _per_call_ns(work_of, many, effort)
    yield against("plant step, rigid", times["rigid"], "ns", "mj_step", times["MuJoCo"], Goal(0.15, "ratio"))
    yield against("plant step, MuJoCo by its pieces", times["pieces"], "ns", "mj_step", times["MuJoCo"])


def _per_call_ns(work_of: dict[str, Any], calls: int, effort: Effort) -> dict[str, float]:
    for work in work_of.values():
        work(1)  # compiles
    timed = {name: (lambda work=work: work(calls)) for name, work in work_of.items()}
    return {name: duration / calls * 1e9 for name, duration in interleaved(timed, effort.rounds).items()}
