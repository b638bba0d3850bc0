"""Two arms in lock-step carry one object up and down until something of them dies at some instant.

The arms' servos, boards, bridges and the program are one process here. What has died does nothing any more: a program's
connections are closed, a bridge's as well, a servo gives its board to the guardian, a board shows no images. The trial
repeats itself to the bit until then, so a run in which nothing dies tells what the other arm would have done.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from typing import Final, NamedTuple, NoReturn

import numpy as np

from qrobot import rci
from qrobot.arrays import Floats
from qrobot.config.deployment import GUARDIAN_TIMEOUT_MS
from qrobot.errors import LinkError, LinkLost, QRobotError, ServoFault
from qrobot.hwif.isa.card import NO_CARD, make_card
from qrobot.hwif.operations import OP_FIELDS
from qrobot.modecodes import Mode
from qrobot.multi_rccl import EQ, TL, TRANS, make_position, move, setvel, wait_for
from qrobot.multi_rccl.program import _program
from qrobot.rccl import gentr_rpy
from qrobot.rccl.program import ending
from qrobot.rccl_bridge.servo_port import STALLED_NS, shows_life
from qrobot.rci import VirtualLink
from qrobot.rig.lockstep import LockstepBridge, LockstepRig
from qrobot.servo.memory.servo_memory import servo_front
from qrobot.servo.memory.telemetry import Rows
from qrobot.servo.process.guardian import N_OWN, N_SAFE_OPS, look
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator, emulator_run
from qrobot.units import NS_PER_MS, NS_PER_S
from qrobot.wire import Hello, RobotState
from tests.support.carried_object import ASIDE_M, newest_frame, torn
from tests.support.two_hands import ROBOT, WORLD, hand, reach

PERIOD_US: Final = 28_000
PERIOD_S: Final = PERIOD_US * 1e-6
SPEED_MM_S: Final = 100.0
HEIGHT_MM: Final = 60.0  # the object goes so far up and down
CARRIED_S: Final = 2.4  # of which all instants of death are: up, all the way down, and nearly up again
AFTERWARDS_S: Final = 1.0
STANDS_RAD_S: Final = 1e-3
KINDS: Final = ("program", "bridge", "servo", "board")
LOOK_NS: Final = NS_PER_MS  # between two of the guardian
KNOWN_NS: Final = {"program": 0, "bridge": 0, "servo": STALLED_NS, "board": 2 * NS_PER_MS}
FRAMES: Final = {"program": 0, "bridge": 2, "servo": 3, "board": 3}
"""Frames after the newest one at which the other arm leaves its way at last, and when somebody knows of the death, ns;
what bridges learn of their servos they learn at a sample."""
STOPPING_MM: Final = 5.0  # way in which an object's frame comes to rest from that speed, with its 5 m/s^2
TRACKING_MM: Final = 2.0  # [A] of both arms together
TORN_MM: Final = {"program": TRACKING_MM, "bridge": 3.0 * PERIOD_S * SPEED_MM_S + STOPPING_MM + TRACKING_MM}
"""The most by which hands that are held at both ends may come apart; after the other deaths one falls, or sticks."""


class Death(NamedTuple):
    """What of which arm dies, and how long after the object has begun to be carried, s. A program is both arms'."""

    kind: str
    victim: str
    after_s: float


class MortalArm:
    """A rig of which parts may die."""

    def __init__(self, name: str, start: Floats | str) -> None:
        self.name = name
        self.rig = LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0), Emulator(ROBOT, start=start))
        self.dead = ""
        self.deaf = False  # the connection between program and bridge is closed
        self.dies_ns: int | None = None
        self._kind = ""
        self._own = np.zeros(N_OWN, dtype=np.int64)
        self._ops = np.zeros((N_SAFE_OPS, OP_FIELDS), dtype=np.int64)
        self._front = servo_front(self.rig.mailbox.words)

    def link(self, hello: Hello) -> VirtualLink:
        """A program's way to it."""
        self.bridge = MortalBridge(self)
        return VirtualLink(hello, self.bridge.transfer)

    def let_die(self, kind: str, after_s: float) -> None:
        """Let this die so long from now."""
        self._kind, self.dies_ns = kind, self.rig.now_ns + round(after_s * 1e3) * NS_PER_MS

    def advance(self, cycles: int) -> None:
        """Let so many cycles pass. Raises LinkLost: the connection was closed on the way."""
        end_ns = self.rig.now_ns + cycles * self.rig.period_ns
        if self.dies_ns is not None and not self.dead and self.dies_ns <= end_ns:
            self._run((self.dies_ns - self.rig.now_ns) // self.rig.period_ns)
            self._die()
        self._run((end_ns - self.rig.now_ns) // self.rig.period_ns)

    def _die(self) -> None:
        self.dead = self._kind
        if self.dead == "program":
            self.bridge.lose()
        if self.dead in ("program", "bridge"):
            self.deaf = True
            self.hang_up()

    def hang_up(self) -> NoReturn:
        """Raise LinkLost, as the end of a connection does."""
        raise LinkLost(f"the {self.dead} of {self.name} was killed")

    def _run(self, cycles: int) -> None:
        rig = self.rig
        if self.dead not in ("servo", "board"):
            rig.ticks(cycles)
            return
        for _ in range(cycles):
            if self.dead == "servo":
                rig.now_ns = emulator_run(rig.emulator.bundle, rig.board, rig.now_ns, rig.substeps)
                timeout_ns = round(GUARDIAN_TIMEOUT_MS * NS_PER_MS)
                look(self._own, self._front, rig.board, make_card(NO_CARD), self._ops, rig.now_ns, timeout_ns)
            else:
                rig.compute()
                rig.now_ns += rig.period_ns
                rig.keep()


class MortalBridge(LockstepBridge):
    """The bridge of such an arm."""

    def __init__(self, arm: MortalArm) -> None:
        super().__init__(arm.rig, PERIOD_US)
        self._arm = arm

    def transfer(self, data: bytes) -> bytes:
        """See `LockstepBridge.transfer`. Raises LinkLost: the connection is closed."""
        if self._arm.deaf:
            self._arm.hang_up()
        return super().transfer(data)

    def lose(self) -> None:
        """The program's end of the connection is gone."""
        self._carry_out(self._session.lose())

    def _pass(self, cycles: int) -> None:
        self._arm.advance(cycles)

    def _sample(self) -> RobotState | None:
        memory = self._rig.mail
        return super()._sample() if shows_life(memory, self._rig.now_ns - int(memory.heartbeat.t_ns)) else None


@dataclass(frozen=True)
class Run:
    """What the logs of both arms say, by name, in the time of the left one from when the object was carried on.

    Attributes:
        waited: frames for which the program let time pass for the arm of which something died, and not for the other.
    """

    rows: dict[str, Rows]
    begin_ns: int
    waited: int


@dataclass(frozen=True)
class Verdict:
    """What came of a death.

    Attributes:
        wrong: what must not be, in words; "" for nothing.
        frames: by which the other arm left its way after the newest frame at the instant at which somebody knew.
        torn_mm: the most by which the hands left their places to each other; nan where a hand has fallen or stuck.
    """

    wrong: str
    frames: int
    torn_mm: float


@contextmanager
def a_program() -> Iterator[None]:
    """Manipulators that are opened in here are those of a program of its own."""
    token = _program.set(None)
    try:
        yield
    finally:
        _program.reset(token)


@cache
def _starts() -> dict[str, Floats]:
    """Joints with which either hand holds the object."""
    arms = {name: MortalArm(name, "park") for name in WORLD}
    with a_program(), rci.use({name: arm.link for name, arm in arms.items()}), ending():
        reach()
    return {name: arm.rig.emulator.q for name, arm in arms.items()}


def carry_until(death: Death | None) -> Run:
    """Carry the object until something dies, or for as long as it may take to; then wait until all has come to rest."""
    arms = {name: MortalArm(name, start) for name, start in _starts().items()}
    begun = dict[str, int]()
    mortal = death or Death("program", "left", CARRIED_S + AFTERWARDS_S)
    with (
        a_program(),
        suppress(LinkError, ServoFault),
        rci.use({name: arm.link for name, arm in arms.items()}),
        ending(),
    ):
        obj, _ = reach()
        begun.update({name: arm.rig.now_ns for name, arm in arms.items()})
        for arm in arms.values() if mortal.kind == "program" else (arms[mortal.victim],):
            arm.let_die(mortal.kind, mortal.after_s)
        setvel(obj, SPEED_MM_S, 30)
        while True:
            for z in (HEIGHT_MM, -HEIGHT_MM):
                move(obj, make_position(TRANS, EQ, gentr_rpy("PLACE", 500, 0, z, 0, 170, 0), TL, TRANS))
                wait_for(obj.completed)
    passed = {name: arm.rig.now_ns - begun[name] for name, arm in arms.items()}
    waited = round((passed.pop(mortal.victim) - min(passed.values())) / (PERIOD_US * 1e3)) - 1
    rows = {name: _rows_to_the_end(arm, begun[name], begun["left"]) for name, arm in arms.items()}
    return Run(rows, begun["left"], max(0, waited))


def _rows_to_the_end(arm: MortalArm, begun_ns: int, begin_ns: int) -> Rows:
    with suppress(QRobotError):
        arm.advance(round(AFTERWARDS_S * NS_PER_S) // arm.rig.period_ns)
    arm.advance(round(AFTERWARDS_S * NS_PER_S) // arm.rig.period_ns)
    rows = arm.rig.rows()
    rows["t_ns"] += begin_ns - begun_ns
    return rows[rows["t_ns"] >= begin_ns]


@cache
def _undisturbed() -> Run:
    return carry_until(None)


def judge(death: Death) -> Verdict:
    """Let it happen, and say what came of it."""
    run = carry_until(death)
    dies_ns = run.begin_ns + round(death.after_s * 1e3) * NS_PER_MS
    others = [name for name in WORLD if death.kind == "program" or name != death.victim]
    verdicts = [_judge_other(name, death.kind, run, dies_ns) for name in others]
    wrong = "; ".join(text for text, _ in verdicts if text)
    held = {name: rows[rows["t_ns"] >= dies_ns] for name, rows in run.rows.items()}
    torn_mm = 1e3 * torn(held) if death.kind in TORN_MM else np.nan
    if torn_mm > TORN_MM.get(death.kind, np.inf):
        wrong = f"{wrong}; the hands come {torn_mm:.1f} mm apart".removeprefix("; ")
    return Verdict(wrong, max(frames for _, frames in verdicts), torn_mm)


def _judge_other(name: str, kind: str, run: Run, dies_ns: int) -> tuple[str, int]:
    """(what must not be, frames by which it left its way too late or in time) of an arm of which nothing has died."""
    rows, whole = run.rows[name], _undisturbed().rows[name]
    newest = newest_frame(rows, dies_ns + KNOWN_NS[kind])
    n = min(rows.size, whole.size)
    other = np.flatnonzero((rows["q_ref"][:n] != whole["q_ref"][:n]).any(axis=1))
    left = int(other[0]) if other.size else n - 1
    frames = int(rows["setpoint_seq"][left]) - newest + run.waited
    on_the_way = (rows["t_ns"][:left] > dies_ns) & (np.abs(rows["v_ref"][:left]).max(axis=1) > STANDS_RAD_S)
    places = np.array([hand(name, q)[:3, 3] for q in rows["q_ref"][rows["t_ns"] >= dies_ns][::4]])
    wrong = []
    if rows["fault"].any():
        wrong.append(f"{name} has fault {rows['fault'].max()}")
    if frames > FRAMES[kind] and on_the_way.any():
        wrong.append(f"{name} goes on for {frames} frames")
    if rows["mode"][-1] != Mode.HOLDING or rows["v_ref"][-1].any():
        wrong.append(f"{name} does not come to rest")
    if np.ptp(places[:, :2], axis=0).max() > ASIDE_M or np.abs(places[:, 2]).max() > HEIGHT_MM * 1e-3 + ASIDE_M:
        wrong.append(f"{name} leaves its path")
    return "; ".join(wrong), frames if on_the_way.any() else 0


def deaths(times: int, seed: int = 0) -> Iterator[Death]:
    """So many deaths of each kind, of either arm at random instants."""
    random = np.random.default_rng(seed)
    for _ in range(times):
        for kind in KINDS:
            yield Death(kind, str(random.choice(list(WORLD))), float(random.uniform(0.05, CARRIED_S)))
