"""How many times faster than the clock on the wall the emulated robot runs, and where the time goes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from benchmarks.rows import Row, against, best_of
from qrobot.config import load_robot
from qrobot.realtime.jit import lean_kernel
from qrobot.rig.experiment import RATES_HZ, program_path, run_program
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.law import KP, KV
from qrobot.servo.loop import one_cycle
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator, emulator_run

TICKS = 20_000
REPEATS = 7


@lean_kernel
def cycles(params: Any, state: Any, law: Any, mail: Any, board: Any, now_ns: int, n: int) -> int:
    """`n` servo cycles on an image that does not change, board and plant left out."""
    for _ in range(n):
        one_cycle(params, state, law, mail, board, now_ns, 0)
        now_ns += 250_000
    return now_ns


def powered_rig(rate_hz: int) -> LockstepRig:
    """A rig that holds the arm."""
    rig = LockstepRig(load_robot("puma560"), ServoSettings(rate_hz=rate_hz), keep_telemetry=False)
    rig.ticks(1)
    rig.mailbox.request_power(True)
    rig.run_for(0.2)
    return rig


def rows() -> Iterator[Row]:
    """The rows."""
    rig = powered_rig(4000)
    program = program_path()
    for rate in RATES_HZ:
        fastest = 0.0
        for _ in range(3):
            whole = LockstepRig(rig.robot, ServoSettings(rate_hz=rate), Emulator(rig.robot))
            whole.ticks(1)
            run_program(whole, program)
            fastest = max(fastest, whole.realtime_factor)
        yield Row(f"lock-step, paper's experiment at {rate} Hz, program to plant", fastest, "x real time")
    step = best_of(REPEATS, lambda: emulator_run(rig.emulator.bundle, rig.board, rig.now_ns, TICKS)) / TICKS
    arguments = (rig.params, rig.state, rig.law, rig.mail, rig.board, rig.now_ns)
    cycles(*arguments, 1)
    cycle = best_of(REPEATS, lambda: cycles(*arguments, TICKS)) / TICKS
    yield Row("board and MuJoCo plant, one step", step * 1e6, "us")
    yield against("servo cycle against the law alone in NumPy", cycle * 1e9, "ns", numpy_law_ns(rig))
    yield Row("lock-step at 4000 Hz, servo, board and plant alone", 250e-6 / (step + cycle), "x real time")


def numpy_law_ns(rig: LockstepRig) -> float:
    """The QRobot law's feedback written with NumPy arrays, ns per evaluation."""
    kp, kv = np.array(rig.params.gains[KP]), np.array(rig.params.gains[KV])
    q, v, gravity, friction = (np.full(kp.size, 0.1) for _ in range(4))
    q_ref, v_ref, limit = q + 0.001, v + 0.001, np.full(kp.size, 50.0)

    def law() -> None:
        for _ in range(2000):
            np.clip(kp * (q_ref - q) + kv * (v_ref - v) + friction + gravity, -limit, limit)

    return best_of(REPEATS, law) / 2000 * 1e9
