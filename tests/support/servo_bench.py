"""A servo on the bench: its board is cardboard, time is virtual, and the arm goes exactly where it is told.

The test says what the board shows; what the servo writes is kept. No plant and no board kernels: every effect seen here
comes from the cycle alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from qrobot.arrays import Floats
from qrobot.config import Robot, load_robot
from qrobot.faultcodes import FaultCode
from qrobot.hwif.board_memory import LANE_CAPACITY, Lane, local_board_memory
from qrobot.hwif.image import (
    IMAGE_COUNT,
    IMAGE_STATUS,
    IMAGE_T_NS,
    make_image,
)
from qrobot.hwif.operations import OP_ANALOG, OP_FIELDS, OP_OUTPUTS, OP_REFERENCE
from qrobot.hwif.registers import (
    DAC,
    DAC_ZERO,
    DISCRETE,
    DISCRETE_POWER,
    N_DACS,
    STATUS_CALIBRATED,
    STATUS_ESTOP_OK,
    STATUS_POWER,
)
from qrobot.modecodes import Mode
from qrobot.realtime.structure import view_words
from qrobot.servo.analog_lines import AnalogWire
from qrobot.servo.laws.law import Law
from qrobot.servo.laws.shipped import find_law
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.published_state import ServoSnapshot
from qrobot.servo.memory.servo_memory import local_servo_memory
from qrobot.servo.memory.telemetry import Rows, TelemetryLayout
from qrobot.servo.modes import gives_torque
from qrobot.servo.output_lines import OutputWire
from qrobot.servo.parameters import servo_parameters
from qrobot.servo.settings import COUNTED_ONLY, Overrun, ServoSettings
from qrobot.servo.state import make_state
from tests.support.bench_blocks import (
    callable_block,
    cycle_of_blocks,
    in_python,
    mode_of,
    publish_arm,
    take_lanes,
    word_of,
)

START_NS = 1_000_000_000
RING_ROWS = 16
FRAME_NS = 28_000_000
NO_WRITES = (OP_REFERENCE, OP_OUTPUTS, OP_ANALOG)


class Write(NamedTuple):
    """One register write, as posted."""

    t_ns: int
    lane: Lane
    offset: int
    value: int


class ServoBench:
    """One servo, tick by tick.

    Attributes:
        q: where the arm stands. Shape (n,), rad or m.
        follows: the arm stands exactly at the reference while it carries torque.
        estop_ok, panel, calibrated: what STATUS shows; `panel` lets power come on when it is enabled.
        frozen: the board publishes nothing new.
        behind_ns: how old what it publishes is.
        deaf: the board takes no operations.
        status: overrides the whole STATUS word.
        slip: counts added to what an encoder shows, by joint.
        beating: the guardian's heartbeat goes on.
        before: called before every tick with the time, for programs and mishaps.
        references: where the motors are to be, by joint, as last posted.
        outputs: what modules beside the board were told, oldest first.
        analog: what they were told last of analogue outputs, from 0, microvolts.
    """

    def __init__(
        self,
        robot: Robot | None = None,
        *,
        rate_hz: float = 1000.0,
        law: str | Law = "qrobot",
        velocity: str = "difference",
        interpolation: str = "quintic",
        guarded: bool = False,
        pose: str = "park",
        calibrated: bool = True,
        sensor_channels: tuple[int, ...] = (),
        overrun: Overrun = COUNTED_ONLY,
        obeys_model: bool = False,
        position_drives: bool = False,
        outputs: tuple[OutputWire, ...] = (),
        analog_outputs: tuple[AnalogWire, ...] = (),
        board_timeout_ms: float = 1.0,
        exchange_ms: float = 0.0,
        reduced_speed_m_s: float = 0.0,
        tool_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        self.robot = robot or load_robot("puma560")
        n = self.robot.n
        self.settings = ServoSettings(
            rate_hz=rate_hz,
            velocity=velocity,
            interpolation=interpolation,
            guarded=guarded,
            sensor_channels=sensor_channels,
            overrun=overrun,
            position_drives=position_drives,
            outputs=outputs,
            analog_outputs=analog_outputs,
            board_timeout_ms=board_timeout_ms,
            exchange_ms=exchange_ms,
            reduced_speed_m_s=reduced_speed_m_s,
            pots=False,
            tool_m=tool_m,
        )
        self.params = servo_parameters(self.robot, self.settings)
        if not obeys_model:  # cardboard has no mass: no torque explains how it moves
            self.params.watch.unexplained[:] = np.inf
            self.params.watch.impossible[:] = np.inf
            self.params.watch.holds_up[:] = self.params.watch.holds_down[:] = np.inf
            self.params.watch.rise_up[:] = self.params.watch.rise_down[:] = np.inf
        self._law = find_law(law, self.robot) if isinstance(law, str) else law
        self.state = in_python(make_state(self.params, self._law))
        words = local_servo_memory(self.robot.name, "bench", n, self.settings.period_ns, RING_ROWS)
        self.mailbox = ServoMailbox(words)
        self.mail = self.mailbox.memory
        self.board = local_board_memory()
        self.now_ns, self.behind_ns = START_NS, 0
        self.q: Floats = np.array(self.robot.poses[pose])
        self.follows, self.frozen, self.deaf, self.beating = True, False, False, True
        self.estop_ok, self.panel, self.calibrated = True, True, calibrated
        self.status: int | None = None
        self.slip: dict[int, int] = {}
        self.before: list[Callable[[int], object]] = []
        self._writes: list[Write] = []
        self._untold: list[tuple[int, int, NDArray[np.int64]]] = []
        self.references: dict[int, int] = {}
        self.outputs: list[int] = []
        self.analog: dict[int, int] = {}
        self.dac = np.full(N_DACS, -1)
        self.discrete = -1
        self._image = make_image()
        self._rows: list[NDArray[np.int64]] = []
        self._counts, self._no_slip = np.zeros((2, n), dtype=np.int64)
        self._operations = np.zeros((len(Lane), LANE_CAPACITY, OP_FIELDS), dtype=np.int64)
        self._taken = np.zeros(len(Lane), dtype=np.int64)
        self._blocks = callable_block(in_python(self.params)), callable_block(self.state)
        # Views, taken once: to find a field of a record by its name takes Python longer than a cycle takes.
        self._row, self._q_ref = view_words(self.state.row), self.state.q_ref
        self._mail_block = callable_block(self.mail)
        self._heartbeat, self._mode = word_of(self.mail.guardian, "t_ns"), mode_of(self.state)
        self._published = self.mailbox.memory.published.state

    @property
    def board(self) -> Any:
        """The memory of its board."""
        return self._board

    @board.setter
    def board(self, board: Any) -> None:
        self._board, self._board_block = board, callable_block(board)

    @property
    def law(self) -> Law:
        """The law in force; set, it is so at once and without more ado."""
        return self._law

    @law.setter
    def law(self, law: Law) -> None:
        self._law = law
        self.state.swap.law_at = law.address
        self.state.swap.settings[:] = law.values

    # ------------------------------------------------------------------------------------------------- running it

    def tick(self, times: int = 1) -> ServoBench:
        """So many cycles."""
        for _ in range(times):
            for act in self.before:
                act(self.now_ns)
            if not self.frozen:
                self._publish()
            if self.beating:
                self._heartbeat[0] = self.now_ns
            params, state = self._blocks
            cycle_of_blocks(params, state, self._mail_block, self.mailbox.ring, self._board_block, self.now_ns)
            self._rows.append(self._row.copy())
            self.collect()
            if self.follows and gives_torque(int(self._mode[0])):
                self.q = self._q_ref.copy()
            self.now_ns += self.settings.period_ns
        return self

    def run(self, seconds: float) -> ServoBench:
        """Cycles for so much virtual time."""
        return self.tick(round(seconds * 1e9 / self.settings.period_ns))

    def until(self, condition: Callable[[], bool], seconds: float = 5.0) -> int:
        """Tick until it holds; the number of ticks. Fails the test when it does not come true in time."""
        for ticks in range(round(seconds * 1e9 / self.settings.period_ns)):
            if condition():
                return ticks
            self.tick()
        raise AssertionError(f"did not happen in {seconds} s; mode {self.mode.name}, event {self.event.name}")

    def hold(self) -> ServoBench:
        """Power on and holding."""
        self.tick(3)
        self.mailbox.request_power(True)
        self.until(lambda: self.mode in (Mode.HOLDING, Mode.UNCALIBRATED))
        return self

    def wait_for_power(self) -> ServoBench:
        """Power asked for, which nobody lets come on at the panel."""
        self.panel = False
        self.tick(3)
        self.mailbox.request_power(True)
        return self.tick(20)

    def skip(self, n: int) -> None:
        """The loop misses so many cycles."""
        self.now_ns += n * self.settings.period_ns

    def collect(self) -> None:
        """The board applies what was posted, lane by lane."""
        if self.deaf:
            return
        take_lanes(self._board_block, self._operations, self._taken)
        for lane, taken in enumerate(self._taken.tolist()):
            if taken:
                self._apply(lane, self._operations[lane, :taken].copy())

    def _apply(self, lane: int, operations: NDArray[np.int64]) -> None:
        dac = self.dac
        self._untold.append((self.now_ns, lane, operations))
        for kind, offset, value in operations.tolist():
            if kind == OP_REFERENCE:
                self.references[offset] = value
            elif kind == OP_OUTPUTS:
                self.outputs.append(value)
            elif kind == OP_ANALOG:
                self.analog[offset] = value
            elif offset == DISCRETE:
                self.discrete = value
            elif offset >= DAC:
                dac[(offset - DAC) // 2] = value

    # --------------------------------------------------------------------------------------------- looking at it

    @property
    def writes(self) -> list[Write]:
        """Every register write, oldest first. They are told apart when they are asked for: few tests do."""
        for t_ns, lane, operations in self._untold:
            told = (each for each in operations.tolist() if each[0] not in NO_WRITES)
            self._writes += [Write(t_ns, Lane(lane), offset, value) for _, offset, value in told]
        self._untold.clear()
        return self._writes

    @property
    def mode(self) -> Mode:
        return Mode(int(self._published["mode"]))

    @property
    def event(self) -> FaultCode:
        return FaultCode(int(self._published["event"]))

    @property
    def fault(self) -> FaultCode:
        return FaultCode(int(self._published["fault"]))

    @property
    def snapshot(self) -> ServoSnapshot:
        return self.mailbox.snapshot()

    @property
    def powered(self) -> bool:
        """DISCRETE, as last written, enables arm power."""
        return self.discrete > 0 and bool(self.discrete & DISCRETE_POWER)

    @property
    def safe(self) -> bool:
        """Zero torque on all DACs and power off, as last written."""
        return bool(np.all(self.dac == DAC_ZERO)) and not self.powered

    def rows(self, first: int = 0) -> Rows:
        """Telemetry of every tick so far, from that number on."""
        words = np.array(self._rows[first:])
        return words.view(TelemetryLayout(self.robot.n).dtype).reshape(len(words))

    def ticks_since(self, t_ns: int) -> int:
        """Whole cycles between a time and the last tick."""
        return (self.now_ns - self.settings.period_ns - t_ns) // self.settings.period_ns

    # ------------------------------------------------------------------------------------------------------ inside

    def _status(self) -> int:
        if self.status is not None:
            return self.status
        power = STATUS_POWER if self.powered and self.panel and self.estop_ok else 0
        return power | STATUS_ESTOP_OK * self.estop_ok | STATUS_CALIBRATED * self.calibrated

    def _publish(self) -> None:
        image = self._image
        image[IMAGE_T_NS] = self.now_ns - self.behind_ns
        image[IMAGE_COUNT] += 1
        image[IMAGE_STATUS] = self._status()
        slip = self._no_slip
        if self.slip:
            slip = slip.copy()
            for joint, slipped in self.slip.items():
                slip[joint] = slipped
        publish_arm(self._blocks[0], self._board_block, self.q, slip, self._counts, image)


def writes_at(bench: ServoBench, t_ns: int) -> list[tuple[int, int]]:
    """(offset, value) written in the tick at `t_ns`, in order."""
    return [(write.offset, write.value) for write in bench.writes if write.t_ns == t_ns]


# ----------------------------------------------------------------------------------------------------------- programs

Path = Callable[[float], Floats]


def cruise(start: Floats, velocity: Floats, ramp_s: float = 0.4) -> Path:
    """From rest to constant velocity; the velocity rises as a half cosine."""

    def path(t: float) -> Floats:
        if t <= 0.0:
            return start.copy()
        if t < ramp_s:
            return start + velocity * 0.5 * (t - ramp_s / np.pi * np.sin(np.pi * t / ramp_s))
        return start + velocity * (t - 0.5 * ramp_s)

    return path


def swing(start: Floats, amplitude: Floats, seconds: float) -> Path:
    """Out by `amplitude` and back, once, smoothly; then at rest."""

    def path(t: float) -> Floats:
        x = min(max(t / seconds, 0.0), 1.0)
        return start + amplitude * 0.5 * (1.0 - np.cos(2.0 * np.pi * (x - np.sin(2 * np.pi * x) / (2 * np.pi))))

    return path


@dataclass
class Program:
    """Sends a frame of setpoints per period, as a client's packets arrive: put its `step` into `bench.before`.

    Attributes:
        path: setpoint as a function of the program's own time.
        skew: how much longer the program's period is than it says (clock skew).
        dropped: sequence numbers that never arrive.
        delayed: seconds by which a frame arrives later, by sequence number; later frames do not overtake it.
        edit: changes (modes, values) of a frame before it is sent.
        last: sequence number after the last frame, None to go on.
    """

    bench: ServoBench
    path: Path
    period_ns: int = FRAME_NS
    stream: int = 1
    skew: float = 0.0
    start_ns: int = -1
    dropped: set[int] = field(default_factory=set)
    delayed: dict[int, float] = field(default_factory=dict)
    edit: Callable[[int, list[int], Floats], None] = lambda _seq, _modes, _values: None
    last: int | None = None
    seq: int = 0
    sent_ns: int = -1

    def step(self, now_ns: int) -> None:
        """Send what is due."""
        if self.start_ns < 0:
            self.start_ns = now_ns
        while (self.last is None or self.seq < self.last) and (due := self.due_ns(self.seq)) <= now_ns:
            if self.seq not in self.dropped:
                self.send(self.seq, due)
            self.seq += 1

    def due_ns(self, seq: int) -> int:
        """When a frame arrives."""
        late = int(self.delayed.get(seq, 0.0) * 1e9)
        return self.start_ns + round(seq * self.period_ns * (1.0 + self.skew)) + late

    def send(self, seq: int, t_ns: int) -> None:
        """Push one frame."""
        values = self.path(seq * self.period_ns * 1e-9)
        modes = [1] * len(values)
        self.edit(seq, modes, values)
        if self.bench.mailbox.push_setpoint(self.stream, seq, t_ns, self.period_ns, modes, values):
            self.sent_ns = t_ns


def play(bench: ServoBench, path: Path, **options: object) -> Program:
    """Let a program run on the bench from now on."""
    program = Program(bench, path, **options)  # type: ignore[arg-type]
    bench.before.append(program.step)
    return program


def moving(bench: ServoBench, speed: float = 0.5, joint: int = 0, seconds: float = 0.8, **options: object) -> Program:
    """A bench that tracks one joint at constant velocity, well into its cruise."""
    velocity = np.zeros(bench.robot.n)
    velocity[joint] = speed
    bench.hold()
    program = play(bench, cruise(bench.q, velocity), **options)
    bench.run(seconds)
    assert bench.mode is Mode.TRACKING
    return program


def changes(rows: Rows) -> Iterator[tuple[Mode, Mode]]:
    """Mode transitions in telemetry."""
    for before, after in pairwise(rows["mode"]):
        if before != after:
            yield Mode(before), Mode(after)
