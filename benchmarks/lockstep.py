"""Row 4c: how many times faster than the wall clock the emulated robot runs, repeats itself, and agrees with itself."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from time import perf_counter
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.box import FRAME_NS, setpoints
from benchmarks.rows import Goal, Row, row
from benchmarks.timing import Effort, interleaved
from qrobot.config import load_robot
from qrobot.errors import QRobotError
from qrobot.modecodes import Mode
from qrobot.realtime.jit import lean_kernel
from qrobot.rig.experiment import program_path, run_program
from qrobot.rig.lockstep import LockstepRig, run_ticks
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT, frame_dtype, push_frame
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.plant import Physics

MOTION_S: Final = 60.0  # robot time
RATE_HZ: Final = 4000
PROGRAM_RATES_HZ: Final = (1000, 2000, 4000)
REPEATS: Final = 3
SLOWEST: Final[dict[Physics, float]] = {"rigid": 300.0, "mujoco": 100.0}
PLANTS: Final[dict[Physics, str]] = {"rigid": "rigid plant", "mujoco": "MuJoCo"}


@lean_kernel
def play(
    params: Any, state: Any, mail: Any, ring: Any, board: Any, emulator: Any, frames: Any, now_ns: int, substeps: int
) -> int:
    """Servo, board and plant through all `frames`, shape (k,), each handed over when its time has come."""
    for k in range(frames.shape[0]):
        frames[k].t_ns = now_ns
        push_frame(mail, frames[k])
        until_ns = now_ns + FRAME_NS
        n = (until_ns - now_ns) // params.period_ns
        now_ns = run_ticks(params, state, mail, ring, board, emulator, now_ns, n, substeps)
    return now_ns


def frames_of(positions: NDArray[np.float64]) -> Any:
    """Frames of one stream that ask for `positions`, shape (k, n)."""
    k, n = positions.shape
    frames = np.zeros(k, dtype=frame_dtype(n)).view(np.recarray)
    frames.stream, frames.seq, frames.period_ns = 1, np.arange(k), FRAME_NS
    frames.modes, frames["values"] = POSITION_SETPOINT, positions
    return frames


def powered_rig(physics: Physics, keep_telemetry: bool = False) -> LockstepRig:
    """A rig that holds the arm at its ready pose."""
    robot = load_robot("puma560")
    emulator = Emulator(robot, physics=physics, start="ready")
    rig = LockstepRig(robot, ServoSettings(rate_hz=RATE_HZ), emulator, keep_telemetry=keep_telemetry)
    rig.ticks(1)
    rig.mailbox.request_power(True)
    rig.run_for(0.2)
    return rig


def rows(effort: Effort) -> Iterator[Row]:
    """The rows."""
    path = setpoints(load_robot("puma560"), max(1.0, effort.work * MOTION_S))
    yield from loop_rows(path, effort)
    yield from repeat_rows(path)
    rates = PROGRAM_RATES_HZ if effort.cold else PROGRAM_RATES_HZ[-1:]
    for rate in rates:
        goal = Goal(50.0, at_least=True) if rate == RATE_HZ else None
        yield row(f"lock-step at {rate} Hz, MuJoCo, program to plant", program_factor(rate, effort), "x", goal)


def loop_rows(path: NDArray[np.float64], effort: Effort) -> Iterator[Row]:
    """Servo, board and plant in one compiled loop, through the box motion."""
    for physics in PLANTS:
        play_once(physics, path[:2])
    factors: dict[Physics, float] = dict.fromkeys(PLANTS, 0.0)
    for _ in range(effort.rounds):
        for physics in PLANTS:
            factors[physics] = max(factors[physics], play_once(physics, path))
    for physics, plant in PLANTS.items():
        goal = Goal(SLOWEST[physics], at_least=True)
        yield row(f"lock-step at {RATE_HZ} Hz, {plant}, compiled loop", factors[physics], "x", goal)


def play_once(physics: Physics, path: NDArray[np.float64]) -> float:
    """Robot time over wall-clock time. Raises QRobotError when the servo does not follow to the end."""
    rig, frames = powered_rig(physics), frames_of(path)
    arguments = (rig.params, rig.state, rig.mail, rig.mailbox.ring, rig.board, rig.emulator.bundle)
    began_ns, began_s = rig.now_ns, perf_counter()
    rig.now_ns = play(*arguments, frames, rig.now_ns, rig.substeps)
    took_s = perf_counter() - began_s
    _check_tracking(rig)
    return (rig.now_ns - began_ns) * 1e-9 / took_s


def _check_tracking(rig: LockstepRig) -> None:
    seen = rig.mailbox.snapshot()
    if seen.mode != Mode.TRACKING or seen.event:
        raise QRobotError(f"the box motion ended in {Mode(seen.mode).name} with event {seen.event}, not in tracking")


def repeat_rows(path: NDArray[np.float64]) -> Iterator[Row]:
    """The same motion again and again, bit for bit; and with both plants."""
    seen: dict[Physics, NDArray[np.float64]] = {}
    for physics, plant in PLANTS.items():
        digests = set()
        for _ in range(REPEATS):
            digest, seen[physics] = watched(physics, path)
            digests.add(digest)
        name = f"different telemetry of {REPEATS} equal runs, {plant}"
        yield row(name, len(digests) - 1, "", Goal(0))
    apart = float(np.abs(seen["rigid"] - seen["mujoco"]).max())
    yield row("largest distance between the plants", apart, "rad", Goal(1e-4))


def watched(physics: Physics, path: NDArray[np.float64]) -> tuple[str, NDArray[np.float64]]:
    """Digest of all telemetry of a run, and the true positions after each frame. Shape (frames, n)."""
    rig, frames, positions = powered_rig(physics, keep_telemetry=True), frames_of(path), []
    for frame in frames:
        frame.t_ns = rig.now_ns
        push_frame(rig.mail, frame)
        rig.ticks(FRAME_NS // rig.period_ns)
        positions.append(rig.emulator.q)
    _check_tracking(rig)
    return hashlib.sha256(rig.rows().tobytes()).hexdigest(), np.array(positions)


def program_factor(rate_hz: int, effort: Effort) -> float:
    """The paper's experiment with everything a program meets: library, packets, bridge, servo, board, MuJoCo."""
    robot, program = load_robot("puma560"), program_path()

    def fly() -> None:
        rig = LockstepRig(robot, ServoSettings(rate_hz=rate_hz), Emulator(robot))
        rig.ticks(1)
        run_program(rig, program)
        factors.append(rig.realtime_factor)

    factors: list[float] = []
    interleaved({"program": fly}, effort.rounds)
    return max(factors)
