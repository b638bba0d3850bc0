"""Hours of emulated operation on virtual time: random moves through the stream of setpoints, every cycle logged.

    python -m benchmarks soak --hours 1

The moves are drawn with a seed, planned by the motion engine and handed to the servo frame by frame, as the bridge
does. What has to come of it: no fault, every cycle in the log, an error within its bound, memory that does not grow.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.box import FRAME_NS
from qrobot.config import Robot, load_robot
from qrobot.errors import QRobotError
from qrobot.faultcodes import FaultCode
from qrobot.log.header import LOCKSTEP, header_for
from qrobot.log.mcap_scan import scan_file
from qrobot.log.writer import LogWriter
from qrobot.modecodes import Mode
from qrobot.motion import Generator, JointSpeed, MoveRequest, motion_limits
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.memory.telemetry import Rows
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.plant import Physics

RATE_HZ: Final = 4000
SPEEDS: Final = (0.2, 1.0)  # rad/s of the fastest joint
ROOM: Final = 0.1  # share of each joint's range left free at both ends
WARM_UP_S: Final = 5.0  # robot time until memory is looked at
PART_BYTES: Final = 64 << 20
ERROR_BOUND: Final = 0.015  # rad or m, any joint; six minutes show 0.007
MEMORY_BOUND: Final = 16 << 20  # bytes of growth
FLUSH_FRAMES: Final = 8


@dataclass
class Soak:
    """What came of it so far.

    Attributes:
        cycles: of the servo. logged: rows found in the log files, in order and without a gap.
        moves: commanded. fault: name of the first event while under power, "" for none.
        largest_error: per joint, rad or m. growth: bytes of resident memory since the warm-up.
        robot_s, wall_s: virtual and real duration.
    """

    cycles: int = 0
    logged: int = 0
    moves: int = 0
    fault: str = ""
    largest_error: tuple[float, ...] = ()
    growth: int = 0
    robot_s: float = 0.0
    wall_s: float = 0.0

    @property
    def failures(self) -> list[str]:
        """What did not hold, in words."""
        found = []
        if self.fault:
            found.append(f"event {self.fault}")
        if self.logged != self.cycles:
            found.append(f"{self.cycles - self.logged} of {self.cycles} cycles are missing in the log")
        if not max(self.largest_error, default=0.0) <= ERROR_BOUND:
            found.append(f"tracking error {max(self.largest_error):.4f} above {ERROR_BOUND}")
        if self.growth > MEMORY_BOUND:
            found.append(f"memory grew by {self.growth >> 20} MiB")
        return found

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return asdict(self) | {"failures": self.failures, "times_real_time": self.robot_s / max(self.wall_s, 1e-9)}


class RandomMoves:
    """An endless program of random moves within the middle of every joint's range."""

    def __init__(self, robot: Robot, seed: int, start: NDArray[np.float64]) -> None:
        self._random = np.random.default_rng(seed)
        limits = robot.limits
        free = ROOM * (limits.q_max - limits.q_min)
        self._low, self._high = limits.q_min + free, limits.q_max - free
        self._generator = Generator(motion_limits(robot), FRAME_NS * 1e-9, start)
        self._tick = 0
        self.moves = 0

    def next_frame(self) -> NDArray[np.float64]:
        """Setpoint of the next sample period. Shape (n,), rad or m."""
        while self._generator.waiting < 2:
            target, speed = self._random.uniform(self._low, self._high), self._random.uniform(*SPEEDS)
            self._generator.push(MoveRequest("random", target, JointSpeed(speed)))
            self.moves += 1
        self._tick += 1
        return self._generator.update(self._tick).q


class CountedLog:
    """A rotated log whose finished parts are read back, counted and deleted."""

    def __init__(self, folder: Path, robot: Robot, period_ns: int) -> None:
        header = header_for(robot, period_ns, "qrobot", LOCKSTEP, "nominal")
        self._writer = LogWriter(folder / "soak.mcap", header, max_bytes=PART_BYTES)
        self._counted, self.rows = 0, 0

    def append(self, rows: Rows, flush: bool) -> None:
        """Write rows; from time to time also look at what has been finished."""
        self._writer.append(rows)
        if flush:
            self._writer.flush()
            self._count(self._writer.parts[:-1])

    def close(self) -> None:
        """End the log and count the rest."""
        self._writer.close()
        self._count(self._writer.parts)

    def _count(self, finished: list[Path]) -> None:
        for part in finished[self._counted :]:
            for block in scan_file(part).rows:
                self._expect(block["tick"])
            part.unlink()
            self._counted += 1

    def _expect(self, ticks: NDArray[np.int64]) -> None:
        """Rows follow on without a gap. Raises QRobotError when they do not."""
        expected = np.arange(self.rows + 1, self.rows + 1 + ticks.size)
        if not np.array_equal(ticks, expected):
            raise QRobotError(f"the log jumps after cycle {self.rows}")
        self.rows += int(ticks.size)


def soak(
    hours: float,
    seed: int = 0,
    physics: Physics = "mujoco",
    folder: Path | None = None,
    progress: Callable[[Soak], object] = lambda _: None,
) -> Soak:
    """Run for so many hours of robot time; `folder` takes the log's parts until they are counted."""
    with tempfile.TemporaryDirectory(dir=folder) as own:
        return _run(round(hours * 3600e9 / FRAME_NS), seed, physics, Path(own), progress)


def _run(frames: int, seed: int, physics: Physics, folder: Path, progress: Callable[[Soak], object]) -> Soak:
    robot = load_robot("puma560")
    rig = LockstepRig(robot, ServoSettings(rate_hz=RATE_HZ), Emulator(robot, physics=physics, seed=seed, start="ready"))
    log, result, began_s = CountedLog(folder, robot, rig.period_ns), Soak(), perf_counter()
    moves = RandomMoves(robot, seed, robot.poses["ready"])
    errors, memory = np.zeros(robot.n), 0
    _power_on(rig)
    for seq in range(frames):
        values = moves.next_frame().tolist()
        rig.mailbox.push_setpoint(1, seq, rig.now_ns, FRAME_NS, [POSITION_SETPOINT] * robot.n, values)
        rig.ticks(FRAME_NS // rig.period_ns)
        rows = rig.take_rows()
        log.append(rows, seq % FLUSH_FRAMES == 0)
        errors = np.maximum(errors, _errors(rows))
        result.fault = result.fault or _event(rows)
        if seq * FRAME_NS <= WARM_UP_S * 1e9:
            memory = resident_bytes()
        result.robot_s, result.wall_s = rig.now_ns * 1e-9, perf_counter() - began_s
        progress(result)
    log.close()
    result.growth, result.moves = max(0, resident_bytes() - memory), moves.moves
    result.cycles, result.logged = int(rig.mailbox.snapshot().tick), log.rows
    result.largest_error = tuple(errors.tolist())
    return result


def _power_on(rig: LockstepRig) -> None:
    rig.ticks(1)
    rig.mailbox.request_power(True)
    rig.run_for(0.3)


def _errors(rows: Rows) -> NDArray[np.float64]:
    """Largest tracking error of each joint. Shape (n,)."""
    tracked = rows[rows["mode"] == Mode.TRACKING]
    off = np.abs(tracked["q_ref"] - tracked["q"])
    return np.asarray(off.max(axis=0, initial=0.0))


def _event(rows: Rows) -> str:
    """The first event of these rows."""
    codes = rows["fault"][rows["fault"] != 0]
    return FaultCode(int(codes[0])).name if codes.size else ""


def resident_bytes() -> int:
    """Memory of this process that is in use."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096
