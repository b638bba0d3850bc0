"""The paper's fast leg in lock-step with something that breaks on the way, and how the servo took it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from qrobot.arrays import Floats, Words
from qrobot.config import load_robot
from qrobot.faultcodes import FaultCode
from qrobot.hwif.registers import DAC_ZERO, DISCRETE, DISCRETE_POWER, N_DACS
from qrobot.hwif.trace import load_head, read_trace
from qrobot.modecodes import Mode
from qrobot.motion import Generator, JointSpeed, MoveRequest, motion_limits
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.memory.telemetry import Rows
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.faults import FaultPlan

PUMA = load_robot("puma560")
N = PUMA.n
FRAME_S = 0.028
FRAME_NS = 28_000_000
FAST = 1.05  # rad/s of the fastest joint: the paper's way back at triple speed
SAMPLE_S = FRAME_S / 7  # how often the campaign looks where the arm truly is


@cache
def fast_leg() -> Floats:
    """Setpoints from the end position to the park position, one row per 28 ms."""
    generator = Generator(motion_limits(PUMA), FRAME_S, PUMA.poses["end"])
    generator.push(MoveRequest("park", PUMA.poses["park"], JointSpeed(FAST)))
    rows, tick = [PUMA.poses["end"]], 0
    while True:
        tick += 1
        output = generator.update(tick)
        rows.append(output.q)
        if not output.moving:
            return np.array([*rows, *[output.q] * 10])


def writes_since(board: Words, head: int) -> NDArray[np.int64]:
    """DAC and DISCRETE writes after the first `head`; as many as the trace still holds. Shape (k, 4)."""
    trace = read_trace(board)
    return np.asarray(trace[len(trace) - min(int(load_head(board)) - head, len(trace)) :])


@dataclass(frozen=True, eq=False)
class Outcome:
    """What came of a fault.

    Attributes:
        rig: the arm and its servo, where the fault left them.
        place: where the fault stands in the board, -1 for one that is none of the board's.
        rows: telemetry from the tick of the injection on.
        true_q: where the arm truly was, `SAMPLE_S` apart. Shape (k, n).
        trace: DAC and DISCRETE writes, as the board stamped them.
    """

    rig: LockstepRig
    place: int
    rows: Rows
    true_q: Floats
    trace: NDArray[np.int64]

    @property
    def acted(self) -> int:
        """Steps of the board in which the fault made a difference."""
        return self.rig.emulator.faults.report(self.place).acted

    @property
    def reaction(self) -> int:
        """Ticks from the injection to the first one in FAULT or STOPPING; -1 for none."""
        gone = np.isin(self.rows["mode"], [Mode.FAULT, Mode.STOPPING])
        return int(np.argmax(gone)) if gone.any() else -1

    @property
    def code(self) -> FaultCode:
        """What it reacted to."""
        return FaultCode(int(self.rows["fault"][self.reaction])) if self.reaction >= 0 else FaultCode.NONE

    @property
    def modes(self) -> list[Mode]:
        """Modes passed through, in order."""
        modes = self.rows["mode"]
        changed = np.flatnonzero(np.diff(modes)) + 1
        return [Mode(int(modes[k])) for k in (0, *changed)]

    @property
    def cut_at_once(self) -> bool:
        """The tick of the reaction wrote zero torque to every DAC, and power off."""
        now = self.trace[self.trace[:, 0] == self.rows["t_ns"][self.reaction]]
        dacs, discrete = now[now[:, 2] != DISCRETE], now[now[:, 2] == DISCRETE]
        return len(dacs) == N_DACS and bool(np.all(dacs[:, 3] == DAC_ZERO)) and _power_is_off(discrete)

    def travel(self) -> Floats:
        """How far each joint went after the reaction. Shape (n,), rad."""
        after = self.true_q[round(self.reaction * self.rig.period_ns * 1e-9 / SAMPLE_S) :]
        return np.asarray(np.abs(after - after[0]).max(axis=0))

    def off_path(self) -> float:
        """Largest distance of the reference from the straight line of the leg while the servo drove, rad.

        A stop after a collision gives way, and leaves the line: it does not count.
        """
        on_path = [Mode.TRACKING] if self.code is FaultCode.COLLISION else [Mode.TRACKING, Mode.STOPPING]
        driven = self.rows[np.isin(self.rows["mode"], on_path)]
        start, way = PUMA.poses["end"], PUMA.poses["park"] - PUMA.poses["end"]
        away = driven["q_ref"] - start
        along = away @ way / (way @ way)
        return float(np.abs(away - along[:, None] * way).max())


def _power_is_off(discrete: NDArray[np.int64]) -> bool:
    """The last of these DISCRETE writes, and there is one, disables arm power."""
    return len(discrete) > 0 and not discrete[-1, 3] & DISCRETE_POWER


class FastLeg:
    """An arm at the start of the fast leg, its servo off.

    Args:
        rate_hz: of the servo.
        faults: what is broken from the start.
        board_timeout_ms: of the servo.
    """

    def __init__(self, rate_hz: float, *faults: str, board_timeout_ms: float = 1.0) -> None:
        emulator = Emulator(PUMA, start="end", physics="rigid", faults=FaultPlan.parse(faults))
        settings = ServoSettings(rate_hz=rate_hz, board_timeout_ms=board_timeout_ms)
        self.rig = LockstepRig(PUMA, settings, emulator)
        self.seq = self.first = 0
        self.stream = 1
        self.offset = np.zeros(N)
        self.true_q: list[Floats] = []

    @property
    def mode(self) -> Mode:
        return Mode(self.rig.mailbox.snapshot().mode)

    @property
    def event(self) -> FaultCode:
        return FaultCode(self.rig.mailbox.snapshot().event)

    def frames(self, n: int) -> None:
        """Let so many sample periods pass."""
        for _ in range(n * round(FRAME_S / SAMPLE_S)):
            self.true_q.append(self.rig.emulator.q)
            self.rig.run_for(SAMPLE_S)

    def power_on(self) -> None:
        """Power on and holding."""
        self.rig.ticks(3)
        self.rig.mailbox.request_power(True)
        self.rig.run_for(0.1)
        assert self.mode is Mode.HOLDING

    def send(self, q: Floats | None = None, seq: int | None = None) -> None:
        """One frame now: the leg's next setpoint, or another one."""
        values = fast_leg()[min(self.first + self.seq, len(fast_leg()) - 1)] + self.offset if q is None else q
        modes = [POSITION_SETPOINT] * N
        number = self.seq if seq is None else seq
        self.rig.mailbox.push_setpoint(self.stream, number, self.rig.now_ns, FRAME_NS, modes, values.tolist())
        self.seq = number + 1

    def begin_stream(self, first: int, offset: Floats) -> None:
        """A new stream: the leg from its setpoint `first` on, shifted."""
        self.stream, self.seq, self.first, self.offset = self.stream + 1, 0, first, offset

    def fly(self, frames: int) -> None:
        """Send so many frames as they fall due."""
        for _ in range(frames):
            self.send()
            self.frames(1)

    def go(self, share: float) -> None:
        """Power on and fly so much of the leg."""
        self.power_on()
        self.fly(round(share * len(fast_leg())))
        assert (self.mode, self.event) == (Mode.TRACKING, FaultCode.NONE)

    def suffer(self, line: str, frames: int) -> Outcome:
        """Let something break now, and go on sending."""
        place = self.rig.emulator.faults.add(line)
        return self.watch(lambda: self.fly(frames), place)

    def watch(self, act: Callable[[], object], place: int = -1) -> Outcome:
        """What comes of `act`."""
        rows, seen = len(self.rig.rows()), len(self.true_q)
        act()
        trace = read_trace(self.rig.board)
        return Outcome(self.rig, place, self.rig.rows()[rows:], np.array(self.true_q[seen:]), trace)
