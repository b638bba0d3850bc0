"""The whole stack in one process on virtual time: deterministic, and as fast as the machine allows.

One servo tick and the plant steps that belong to it alternate in one compiled loop; the bridge's session and the
program see the same packets as over a socket. Nothing waits: virtual time moves only when somebody asks for the next
frame.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import Any, Final

import numpy as np

from qrobot.config import Robot
from qrobot.errors import ConfigError
from qrobot.hwif.board_memory import BoardMemory, local_board_memory
from qrobot.model.payload_judge import PayloadJudge
from qrobot.rccl_bridge.actions import Action, SessionOutcome, carry_out
from qrobot.rccl_bridge.lease import Lease
from qrobot.rccl_bridge.mailbox_port import MailboxPort
from qrobot.rccl_bridge.session import Peer, Session
from qrobot.rccl_bridge.settings import BridgeSettings
from qrobot.rci import VirtualLink
from qrobot.realtime.flat_record import block_of
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.laws.names import law_label
from qrobot.servo.laws.trial_process import tried_law
from qrobot.servo.memory.law_history import LawInForce
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.servo_memory import describe_analog_outputs, local_servo_memory
from qrobot.servo.memory.settings_text import settings_text
from qrobot.servo.memory.telemetry import Rows, TelemetryReader
from qrobot.servo.parameters import ServoParameters, servo_parameters
from qrobot.servo.process.loop import one_cycle
from qrobot.servo.settings import ServoSettings
from qrobot.servo.state import ServoState, make_state
from qrobot.sim_board.emulator import Emulator, EmulatorBundle, emulator_run
from qrobot.units import NS_PER_S
from qrobot.wire import Hello, RobotState

START_NS: Final = NS_PER_S  # virtual time does not begin at zero: nothing may take 0 for "never"
RING_ROWS: Final = 1 << 12


@lean_kernel
def run_ticks(
    params: ServoParameters,
    state: ServoState,
    mail: Any,
    ring: Any,
    board: Any,
    emulator: EmulatorBundle,
    now_ns: int,
    n_ticks: int,
    substeps: int,
) -> int:
    """Advance by `n_ticks` servo cycles from virtual time `now_ns`; returns the time reached.

    Each cycle sees the image of its own instant; what it writes acts from then on.
    """
    late_ns = now_ns - now_ns  # none, and no constant: for a constant the whole cycle would be compiled once more
    for _ in range(n_ticks):
        one_cycle(params, state, mail, ring, board, now_ns, late_ns)
        now_ns = emulator_run(emulator, board, now_ns, substeps)
    return now_ns


@lean_kernel
def run_blocks(
    params: Any, state: Any, mail: Any, ring: Any, board: Any, emulator: Any, now_ns: int, n_ticks: int, substeps: int
) -> int:
    """`run_ticks` for a call from Python, where records come as blocks."""
    bundle = EmulatorBundle(
        emulator.board[0], emulator.drive[0], emulator.plant, emulator.wrist,
        emulator.counts_per_unit, emulator.q_offset, emulator.shaft, emulator.period_ns,
    )  # fmt: skip
    return run_ticks(params[0], state[0], mail[0], ring, board[0], bundle, now_ns, n_ticks, substeps)


class LockstepRig:
    """Emulated board and servo in lock-step.

    Args:
        robot: the arm.
        settings: rate and law of the servo. Its period must be a multiple of the plant's.
        emulator: board and plant; default the robot's nominal one at its start pose.
        keep_telemetry: collect every row in `rows()`.
        board: board memory; default one of this process.

    Attributes:
        now_ns: virtual time.
        loop_arguments: what the compiled loop works on.
        lease: who commands; as in real time, one program at a time.
        realtime_factor: virtual time over wall-clock time of the newest program, from its first packet on: generator,
            packets, bridge, servo, board and plant together.

    Raises:
        ConfigError: the servo's period is no multiple of the plant's; the law did not pass its trial, where one in a
            file is timed, as for a servo.
    """

    def __init__(
        self,
        robot: Robot,
        settings: ServoSettings,
        emulator: Emulator | None = None,
        keep_telemetry: bool = True,
        board: BoardMemory | None = None,
    ) -> None:
        self.robot = robot
        self.settings = settings
        self.emulator = emulator or Emulator(robot)
        period_ns = settings.period_ns
        self.substeps, rest = divmod(period_ns, self.emulator.bundle.period_ns)
        if rest or not self.substeps:
            plant_hz = NS_PER_S / self.emulator.bundle.period_ns
            raise ConfigError(f"{settings.rate_hz} Hz does not divide the plant's {plant_hz:.0f} Hz")
        self.params = servo_parameters(robot, settings, guarded=False)
        self.law = tried_law(settings.law, robot, settings.law_settings, period_ns, timed=False)
        self.state = make_state(self.params, self.law)
        words = local_servo_memory(robot.name, law_label(settings.law), robot.n, period_ns, RING_ROWS)
        describe_analog_outputs(words, settings.analog_ranges)
        self.board = local_board_memory() if board is None else board
        self.mailbox = ServoMailbox(words)
        self.mail = self.mailbox.memory
        self.now_ns = START_NS
        self.lease = Lease()
        self.realtime_factor = 0.0
        self._namings = [(0, 0, "")]  # time and tick from which a program's numbers had which names
        info = self.mailbox.info
        self._reader = TelemetryReader(words, info.telemetry_base, info.telemetry_capacity, robot.n)
        self._kept: list[Rows] | None = [] if keep_telemetry else None
        bundle: Any = self.emulator.bundle
        emulated = bundle._replace(board=block_of(bundle.board), drive=block_of(bundle.drive))
        blocks = block_of(self.params), block_of(self.state), block_of(self.mail)
        self.loop_arguments = (*blocks, self.mailbox.ring, block_of(self.board), emulated)
        self.emulator.connect(self.board, self.now_ns)

    @property
    def period_ns(self) -> int:
        """Length of a servo cycle."""
        return self.settings.period_ns

    def compile(self) -> None:
        """Compile the loop, or load it, without advancing."""
        run_blocks(*self.loop_arguments, self.now_ns, 0, self.substeps)

    def ticks(self, n: int) -> None:
        """Advance by `n` servo cycles, at most the telemetry ring's length at a time."""
        while n > 0:
            chunk = min(n, RING_ROWS // 2)
            self.now_ns = run_blocks(*self.loop_arguments, self.now_ns, chunk, self.substeps)
            self.keep()
            n -= chunk

    def compute(self) -> None:
        """One cycle of the servo, while the plant stands still."""
        run_blocks(*self.loop_arguments, self.now_ns, 1, 0)

    def keep(self) -> None:
        """Take the newest telemetry out of the ring, which is short."""
        if self._kept is not None:
            self._kept.append(self._reader.read())

    def run_for(self, seconds: float) -> None:
        """Advance by `seconds` of virtual time, rounded to whole cycles."""
        self.ticks(round(seconds * NS_PER_S / self.period_ns))

    def note_names(self) -> None:
        """Note the names of a program's numbers for the log, where they are others now."""
        if (names := " ".join(self.mailbox.signal_names())) != self._namings[-1][2]:
            self._namings.append((self.now_ns, self.mailbox.snapshot().tick + 1, names))  # from the next cycle on

    def laws_in_force(self) -> list[LawInForce]:
        """Law, gains and names of signals, for a log: an entry for each time a program's numbers had other names."""
        kp, kv, inertia = (tuple(row) for row in np.array(self.state.swap.gains).tolist())
        law = law_label(self.settings.law), settings_text(self.law.chosen), kp, kv, inertia, " ".join(self.law.signals)
        return [LawInForce(t_ns, tick, *law, names) for t_ns, tick, names in self._namings]

    def rows(self) -> Rows:
        """Telemetry of every cycle so far that has not been taken, oldest first; a copy."""
        layout = self._reader.layout
        if not self._kept:
            return layout.empty(0)
        words = [rows.view(np.int64) for rows in self._kept]  # of rows NumPy would compare the fields, block by block
        self._kept = [np.concatenate(words).view(layout.dtype)]
        return self._kept[0].copy()

    def take_rows(self) -> Rows:
        """The same, once: long runs keep nothing."""
        rows = self.rows()
        if self._kept:
            self._kept.clear()
        return rows


class LockstepBridge:
    """The bridge's session of one program, on the virtual time of a rig."""

    def __init__(self, rig: LockstepRig, period_us: int) -> None:
        self._rig = rig
        self._port = MailboxPort(rig.mailbox.words, PayloadJudge(rig.robot))
        self._began_ns = rig.now_ns
        self._began_s = time.perf_counter()
        self._settings = BridgeSettings(period_us=period_us)
        self._session = self._new_session()

    def _new_session(self) -> Session:
        rig = self._rig
        here, port = Peer("127.0.0.1", 0), self._port
        return Session(
            rig.robot.name, rig.robot.n, rig.lease, self._settings, here, rig.now_ns, judge_payload=port.judge_payload,
            judge_collision=port.judge_collision, judge_analog=port.judge_analog, shared_clock=False,
        )  # fmt: skip

    def transfer(self, data: bytes) -> bytes:
        """Hand over the program's bytes; when nothing answers them at once, let time run until the bridge speaks."""
        answer = b""
        if data and self._session.ended:  # the program has said goodbye and greets again
            self._session = self._new_session()
        if data:
            answer = self._carry_out(self._session.receive(data, self._rig.now_ns)).data
            self._rig.note_names()
        return answer or self._next_state()

    def _carry_out(self, actions: Iterable[Action]) -> SessionOutcome:
        return carry_out(actions, self._port)

    def _pass(self, cycles: int) -> None:
        """Let so many servo cycles pass."""
        self._rig.ticks(cycles)

    def _next_state(self) -> bytes:
        rig, session = self._rig, self._session
        self._pass(max(0, -(-(session.due_ns - rig.now_ns) // rig.period_ns)))
        rig.realtime_factor = (rig.now_ns - self._began_ns) * 1e-9 / (time.perf_counter() - self._began_s)
        return carry_out(session.tick(rig.now_ns, self._sample()), self._port).data

    def _sample(self) -> RobotState | None:
        """Newest sample of the robot; None while the servo is away."""
        return self._port.read_state()


def link_factory(rig: LockstepRig, period_us: int, hello: Hello) -> VirtualLink:
    """A program's way to `rig`: `functools.partial(link_factory, rig, period_us)` is what `qrobot.rccl.use` takes."""
    return VirtualLink(hello, LockstepBridge(rig, period_us).transfer)
