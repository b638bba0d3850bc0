"""One fault under one set of conditions, in lock-step: what the servo called it, how soon, and how far the arm went.

The path is a closed form of its own, not the generator's: one joint speeds up to a constant velocity, the others follow
with a third of it. The frames of the stream come on time, late, or now and then not at all; the servo may be kept from
running while the board goes on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from qrobot.arrays import Floats
from qrobot.config import load_robot
from qrobot.faultcodes import FaultCode
from qrobot.hwif.board_memory import PANEL_MICRO
from qrobot.modecodes import Mode
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.calibration.table import load_table
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.settings import Overrun, ServoSettings
from qrobot.sim_board.emulator import Emulator, emulator_run
from qrobot.sim_board.mismatch import PlantMismatch
from qrobot.units import NS_PER_S

PUMA: Final = load_robot("puma560")
TABLE: Final = load_table("puma560", PUMA)
N: Final = PUMA.n
FRAME_NS: Final = 28_000_000
RAMP_S: Final = 0.3  # from rest to the constant velocity
LEAD_S: Final = 0.7  # of the motion, before something breaks
WATCH_S: Final = 1.6  # afterwards
POWER_S: Final = 0.3  # from the first torque to the first frame
HAND_NM_RAD: Final = 100.0  # of whoever holds the wrist until there is torque
HAND_NM_S_RAD: Final = 1.0
JITTER_NS: Final = 10_000_000  # how late a frame may come
LOST: Final = 0.1  # share of frames that do not come; never two in a row
STALL_NS: Final = 12_000_000  # how long the servo is kept from running
STALLS_EVERY: Final = 9  # frames
COUNTED: Final = Overrun(misses_in_a_row=0, late_share=1.0)  # late cycles of an emulated arm are only counted
MIDDLE: Final = np.array([0.0, -1.2, 1.9, 0.3, 0.0, 0.2])  # of every path: elbow bent, far from every limit
PAYLOAD_KG: Final = 2.5
DRAW: Final = 3  # of the mismatched plant


@dataclass(frozen=True)
class Conditions:
    """Under what a fault comes.

    Attributes:
        joint: that moves most, from 0; faults of a joint are this one's.
        speed: of that joint, rad/s.
        moving: the fault comes in motion, else while the arm is held at rest, 0.3 s before the motion begins.
        loaded: 2.5 kg at the flange and a mismatched plant, of neither of which the servo knows.
        stream: "even", "jitter", "loss" or "stalls".
        rate_hz: of the servo.
        direction: of the motion.
        table: the servo has a calibration table, and so looks at the potentiometers.
    """

    joint: int
    speed: float
    moving: bool = True
    loaded: bool = False
    stream: str = "even"
    rate_hz: float = 1000.0
    direction: int = 1
    table: bool = True

    def __str__(self) -> str:
        where = "moving" if self.moving else "at rest"
        load = "loaded" if self.loaded else "nominal"
        return (
            f"joint {self.joint + 1} {self.direction * self.speed:+.2f} rad/s {where} {load} "
            f"{self.stream} {self.rate_hz:.0f} Hz{'' if self.table else ' no table'}"
        )


@dataclass(frozen=True)
class Result:
    """What came of it.

    Attributes:
        code: of the first reaction; NONE when there was none.
        ends: what the arm was cut or stopped for in the end.
        mode: in the end.
        reaction_s: from the fault to the first cycle of a stop; infinite for none.
        cut_s: from the fault to the cycle that took the torque away; infinite when it was left on.
        strayed_rad: how far any joint was from the path at most while it had torque.
        coasted_rad: how far any joint went after the torque was gone.
        fastest: speed of any joint in units of its limit, while it had torque.
        false_alarm: the arm stopped before anything had broken.
    """

    code: FaultCode
    ends: FaultCode
    mode: Mode
    reaction_s: float
    cut_s: float
    strayed_rad: float
    coasted_rad: float
    fastest: float
    false_alarm: bool

    @property
    def name(self) -> FaultCode:
        """What the operator is told in the end: the fault, or the reason of a stop that left the arm held."""
        return self.code if self.ends is FaultCode.NONE else self.ends


def way(conditions: Conditions, t: Floats) -> Floats:
    """How far the joints have gone at times `t` of the motion, rad. Shape (len(t), n)."""
    return _ramp(t)[:, None] * _velocities(conditions)


def _ramp(t: Floats) -> Floats:
    """Way at unit velocity: from rest at 0 to constant velocity at RAMP_S, velocity 3u^2 - 2u^3 in between, s."""
    u = np.clip(t / RAMP_S, 0.0, None)
    return np.asarray(np.where(u < 1.0, u**3 - 0.5 * u**4, u - 0.5) * RAMP_S)


def _velocities(conditions: Conditions) -> Floats:
    """Constant velocities of the joints, rad/s: the wrist turns against the arm. Shape (n,)."""
    share = np.full(N, conditions.speed / 3.0)
    share[conditions.joint] = conditions.speed
    velocities = conditions.direction * np.minimum(share, 0.9 * PUMA.limits.v_max)
    velocities[3:] *= -1.0
    return np.asarray(velocities)


def _start(conditions: Conditions) -> Floats:
    """Where the arm is put: half of the path lies before `MIDDLE`. Without power the wrist sags. Shape (n,), rad."""
    return np.asarray(MIDDLE - 0.5 * _ramp(np.array([LEAD_S + WATCH_S]))[0] * _velocities(conditions))


class Trial:
    """An arm held at the start of the path, and its stream.

    Args:
        conditions: see there.
    """

    def __init__(self, conditions: Conditions) -> None:
        self.conditions = conditions
        mismatch = PlantMismatch.mismatched(N, seed=DRAW) if conditions.loaded else None
        emulator = Emulator(
            PUMA,
            start=_start(conditions),
            physics="rigid",
            mismatch=mismatch,
            payload_kg=PAYLOAD_KG if conditions.loaded else 0.0,
        )
        table = TABLE if conditions.table else None
        settings = ServoSettings(rate_hz=conditions.rate_hz, overrun=COUNTED, calibration=table)
        self.rig = LockstepRig(PUMA, settings, emulator)
        self._random = np.random.default_rng(11)
        self._seq = 0
        self._skipped = False
        self._from = _start(conditions)
        self._true: list[tuple[int, Floats]] = []

    def run(self, line: str | None) -> Result:
        """Power on, move, let `line` break, and go on as if nothing had happened; None breaks nothing."""
        rig = self.rig
        self._power_on()
        self._from = np.array(rig.mailbox.snapshot().q_setpoint)
        lead = round((LEAD_S if self.conditions.moving else 0.3) * 1e9 / FRAME_NS)
        self._fly(lead)
        before = len(rig.rows())
        if line is not None:
            rig.emulator.faults.add(line)
        broken_ns = rig.now_ns
        self._fly(round(WATCH_S * 1e9 / FRAME_NS))
        return self._judge(before, broken_ns)

    def move_again(self) -> tuple[bool, float]:
        """Ask for the motion anew from where the arm is held; whether it was stopped, and how far a joint went, rad."""
        rig, start = self.rig, self.rig.emulator.q.copy()
        begin = np.array(rig.mailbox.snapshot().q_setpoint)
        for seq in range(round(WATCH_S * 1e9 / FRAME_NS)):
            q = begin + way(self.conditions, np.array([seq * FRAME_NS * 1e-9]))[0]
            rig.mailbox.push_setpoint(2, seq, rig.now_ns, FRAME_NS, [POSITION_SETPOINT] * N, q.tolist())
            self._run(FRAME_NS)
            if Mode(rig.mailbox.snapshot().mode) not in (Mode.HOLDING, Mode.TRACKING):
                return True, float(np.abs(rig.emulator.q - start).max())
        return False, float(np.abs(rig.emulator.q - start).max())

    def _power_on(self) -> None:
        """Power on while somebody holds the wrist, which has no brakes."""
        rig, q = self.rig, self.rig.emulator.q.copy()
        hand = rig.board.panel.push  # a view, taken once: Python is slow to find it
        while rig.state.mode != Mode.HOLDING:
            assert rig.now_ns < 3 * NS_PER_S, f"no power: {rig.mailbox.snapshot()}"
            rig.mailbox.request_power(rig.now_ns > 1.5 * NS_PER_S)
            push = HAND_NM_RAD * (q - rig.emulator.q) - HAND_NM_S_RAD * rig.emulator.v
            hand[:] = (push * PANEL_MICRO).astype(np.int64)
            rig.ticks(1)
        hand[:] = 0
        rig.run_for(POWER_S)

    def _fly(self, frames: int) -> None:
        for _ in range(frames):
            late_ns = self._send_next()
            self._run(FRAME_NS - late_ns)

    def _send_next(self) -> int:
        """Send the frame that is due, perhaps late or not at all; returns how late it is."""
        stream, late_ns = self.conditions.stream, 0
        if stream == "jitter":
            period_ns = self.rig.period_ns
            late_ns = int(self._random.integers(0, JITTER_NS // period_ns + 1)) * period_ns
            self._run(late_ns)
        self._skipped = stream == "loss" and not self._skipped and bool(self._random.random() < LOST)
        if not self._skipped:
            self._push()
        self._seq += 1
        if stream == "stalls" and self._seq % STALLS_EVERY == 0:
            self._stall()
            return late_ns + STALL_NS
        return late_ns

    def _push(self) -> None:
        rig, still = self.rig, 0.0 if self.conditions.moving else 0.6
        t = self._seq * FRAME_NS * 1e-9 - still
        q = self._from + way(self.conditions, np.array([t]))[0]
        rig.mailbox.push_setpoint(1, self._seq, rig.now_ns, FRAME_NS, [POSITION_SETPOINT] * N, q.tolist())

    def _run(self, ns: int) -> None:
        """Let time pass, and note where the arm truly is every 4 ms."""
        rig = self.rig
        end_ns = rig.now_ns + ns
        while rig.now_ns < end_ns:
            self._true.append((rig.now_ns, rig.emulator.q.copy()))
            rig.ticks(max(1, min(4_000_000, end_ns - rig.now_ns) // rig.period_ns))

    def _stall(self) -> None:
        """The board goes on alone."""
        rig = self.rig
        steps = STALL_NS // rig.emulator.bundle.period_ns
        rig.now_ns = emulator_run(rig.emulator.bundle, rig.board, rig.now_ns, steps)

    def _judge(self, before: int, broken_ns: int) -> Result:
        rows = self.rig.rows()
        stopped = np.isin(rows["mode"], [Mode.STOPPING, Mode.FAULT])
        alarm = bool(stopped[:before].any())
        after = rows[before:]
        reacted = np.isin(after["mode"], [Mode.STOPPING, Mode.FAULT])
        cut = np.isin(after["mode"], [Mode.FAULT, Mode.OFF])
        first = int(np.argmax(reacted)) if reacted.any() else -1
        cut_ns = int(after["t_ns"][np.argmax(cut)]) if cut.any() else int(rows["t_ns"][-1])
        strayed, coasted, fastest = self._strayed(rows, broken_ns, cut_ns)
        snapshot = self.rig.mailbox.snapshot()
        return Result(
            FaultCode(int(after["fault"][first])) if first >= 0 else FaultCode.NONE,
            FaultCode(snapshot.fault),
            Mode(snapshot.mode),
            (int(after["t_ns"][first]) - broken_ns) * 1e-9 if first >= 0 else np.inf,
            (cut_ns - broken_ns) * 1e-9 if cut.any() else np.inf,
            strayed,
            coasted,
            fastest,
            alarm,
        )

    def _strayed(self, rows: NDArray[np.void], broken_ns: int, cut_ns: int) -> tuple[float, float, float]:
        """Largest distance from the reference while driven, way afterwards (rad), and largest speed while driven."""
        t = np.array([t for t, _ in self._true])
        q = np.array([q for _, q in self._true])
        driven = (t >= broken_ns) & (t <= cut_ns)
        reference = np.array([np.interp(t[driven], rows["t_ns"], rows["q_ref"][:, j]) for j in range(N)]).T
        strayed = np.abs(q[driven] - reference).max(initial=0.0)
        after = q[t > cut_ns]
        coasted = np.abs(after - after[0]).max() if len(after) else 0.0
        speed = np.abs(np.diff(q[driven], axis=0)) / np.maximum(np.diff(t[driven]), 1)[:, None] * 1e9
        return float(strayed), float(coasted), float((speed / PUMA.limits.v_max).max(initial=0.0))
