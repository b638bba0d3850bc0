"""Servo memory: how the servo, its guardian, the bridge and the log meet, without locks.

One writer per block:

* INFO, HEARTBEAT, STATE, the journal and the telemetry ring are written by the servo;
* GUARDIAN is written by the guardian (its heartbeat and the takeover mark);
* COMMAND and the setpoint queue are written by whoever commands (the bridge on behalf of the lease holder).

Requests are counters: raising one asks once, however often the servo looks. Floats travel as their bit patterns in
int64 words; `Words.view(np.float64)` is the other view of the same memory.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from qrobot.arrays import Words
from qrobot.errors import ConfigError, LinkError
from qrobot.printable import printable
from qrobot.realtime.flat_record import float_bits
from qrobot.realtime.jit import lean_kernel
from qrobot.realtime.seqlock import seqlock_read, seqlock_write
from qrobot.realtime.shared_memory import HEADER, HEADER_WORDS, MAGIC_VALUE, SharedMemory
from qrobot.realtime.structure import record_in
from qrobot.servo.memory.law_history import ENTRIES, LAW_BYTES, entry_words, journal_words
from qrobot.servo.memory.setpoint_queue import (
    FRAME_JOINTS,
    QUEUE_CAPACITY,
    QUEUE_START,
    frame_words,
    push_frame,
    queue_end,
)
from qrobot.servo.memory.telemetry import RING_HEADER_WORDS, TelemetryLayout, append_row, ring_capacity, ring_words
from qrobot.servo.stages.interpolation_polynomials import FORMS
from qrobot.servo.stages.velocity import ESTIMATORS

LAYOUT: Final = 5
MAX_JOINTS: Final = 32
FORCE_AXES: Final = 6

# INFO: constant while a servo runs
INFO_JOINTS: Final = HEADER_WORDS
INFO_PERIOD_NS: Final = HEADER_WORDS + 1
INFO_TELEMETRY_BASE: Final = HEADER_WORDS + 2
INFO_TELEMETRY_CAPACITY: Final = HEADER_WORDS + 3
INFO_READY: Final = HEADER_WORDS + 4  # 1 once the loop runs
INFO_ESTIMATOR: Final = HEADER_WORDS + 5  # 1 + place in ESTIMATORS, 0 when not told
INFO_FORM: Final = HEADER_WORDS + 6  # 1 + place in FORMS, 0 when not told
INFO_NAME: Final = HEADER_WORDS + 8  # 64 bytes of UTF-8
INFO_LAW: Final = INFO_NAME + 8  # 64 bytes of UTF-8
NAME_BYTES: Final = LAW_BYTES

# CALIBRATION: how far the servo is with it; the results of the joints stand behind the state block
CALIBRATION_STAGE: Final = 32  # a `servo.calibration.state.Stage`
CALIBRATION_JOINT: Final = 33
CALIBRATION_FOUND: Final = 34  # index pulses of that joint
CALIBRATION_WANTED: Final = 35
CALIBRATION_FIELDS: Final = 3  # of each joint: misfit, margin (floats), votes

# HEARTBEAT of the servo
BEAT_T_NS: Final = 40  # when the last cycle began
BEAT_ARMED: Final = (
    41  # 1 while the board may carry torque, power, or outputs that a stop ends: see `servo.checks.guardian_arming`
)
BEAT_DISCRETE: Final = 42  # what of the DISCRETE register the guardian is to leave, but for power
BEAT_TRIPS_SEEN: Final = 43  # trips of the guardian that a clear has acknowledged
BEAT_LINES: Final = 44  # outputs that there are, output 1 in bit 0
BEAT_KEPT: Final = 45  # of those that hold at a stop, those that are on

# GUARDIAN
GUARD_T_NS: Final = 48  # heartbeat of the guardian
GUARD_TAKEOVER: Final = 49  # 1: the guardian has taken the board; the servo writes nothing more
GUARD_TRIPS: Final = 50  # how often it had to, since it started

# TIME
BEAT_SLIPS: Final = 54  # 1: the arm's time is that of an emulated board, see `hwif.arm_clock`
BEAT_SLIPPED_NS: Final = 55  # how far it lies behind CLOCK_MONOTONIC

# COMMAND
COMMAND_POWER: Final = 56  # 1: the commander wants arm power
COMMAND_CLEARS: Final = 57  # raised to clear a fault
COMMAND_STOPS: Final = 58  # raised to ask for a category 2 stop
COMMAND_SHUTDOWN: Final = 59  # 1: end the daemon after a controlled stop
COMMAND_HAND: Final = 60  # 0 relaxed, 1 open, 2 closed
COMMAND_CALIBRATE: Final = 61  # raised to ask for a calibration
COMMAND_INDEXES: Final = 62  # index pulses a joint for it, 0 for the default
COMMAND_OFFS: Final = 63  # raised to take power away, whatever COMMAND_POWER says until it has been 0

COMMAND_OUTPUTS: Final = 65  # what the commander wants of the outputs, output 1 in bit 0; beside the queue's head
COMMAND_OUTPUTS_NS: Final = 66  # when they last said so, on the servo's clock
COMMAND_HELD_STREAM: Final = 67  # 1 + the stream that moves the arm only while a key is held; 0 for none
COMMAND_HELD_NS: Final = 68  # when the commander last said that the key is held, on the servo's clock

_READ_TRIES: Final = 20
_READ_PAUSE_S: Final = 0.001
_START_TRIES: Final = 500

# STATE: one seqlocked block
(
    STATE_T_NS,
    STATE_TICK,
    STATE_MODE,
    STATE_FAULT,
    STATE_EVENT,
    STATE_JOINT,
    STATE_FLAGS,
    STATE_SEQ,
    STATE_MISSED,
    STATE_LATE,
    STATE_INPUTS,
    STATE_HAND,
    STATE_OUTPUTS,
    STATE_VECTORS,
) = range(14)
FLAG_POWERED: Final = 1
FLAG_CALIBRATED: Final = 2
FLAG_ESTOP_OK: Final = 4
FLAG_GUARDED: Final = 8
FLAG_AT_REST: Final = 16
FLAG_UNSEEN: Final = 32  # in telemetry only


def state_words(n: int) -> int:
    """Words of the state block: integers, then q, v, tau, q_ref of `n` joints, then the force sensor's six axes."""
    return STATE_VECTORS + 4 * n + FORCE_AXES


def _state_seq(n: int) -> int:
    return queue_end(n)


def calibration_base(n: int) -> int:
    """Where the calibration's results stand: misfit of n joints, then margin, then votes."""
    return _state_seq(n) + 8 + state_words(n) + 8


def journal_base(n: int) -> int:
    """Where the journal of laws stands, see `servo.memory.law_history`."""
    return calibration_base(n) + CALIBRATION_FIELDS * n + 8


def _telemetry_base(n: int) -> int:
    return journal_base(n) + journal_words(n) + 8


def memory_words(n: int, telemetry_capacity: int) -> int:
    """Size of the servo memory for `n` joints and a ring of `telemetry_capacity` rows."""
    return _telemetry_base(n) + ring_words(TelemetryLayout(n).row_words, telemetry_capacity)


@dataclass(frozen=True)
class ServoInfo:
    """What a reader has to know before it can read anything else; checked against the size of the memory."""

    robot_name: str
    law: str
    n: int
    period_ns: int
    generation: int
    telemetry_base: int
    telemetry_capacity: int
    ready: bool
    velocity: str
    interpolation: str

    @property
    def rate_hz(self) -> float:
        """Servo rate in hertz."""
        return 1e9 / self.period_ns


def _write_text(words: Words, at: int, text: str) -> None:
    data = text.encode()
    if len(data) > NAME_BYTES:
        raise ConfigError(f"name {text!r} is longer than {NAME_BYTES} bytes")
    words[at : at + NAME_BYTES // 8] = np.frombuffer(data.ljust(NAME_BYTES, b"\0"), dtype=np.int64)


def _read_text(words: Words, at: int) -> str:
    return printable(words[at : at + NAME_BYTES // 8].tobytes().rstrip(b"\0").decode(errors="replace"))


def describe_servo(words: Words, robot_name: str, law: str, n: int, period_ns: int, telemetry_capacity: int) -> None:
    """Fill the INFO block. Raises ConfigError for names or joint counts that do not fit."""
    if not 1 <= n <= MAX_JOINTS:
        raise ConfigError(f"{n} joints: this servo takes 1 to {MAX_JOINTS}")
    words[INFO_JOINTS], words[INFO_PERIOD_NS] = n, period_ns
    words[INFO_TELEMETRY_BASE], words[INFO_TELEMETRY_CAPACITY] = _telemetry_base(n), telemetry_capacity
    _write_text(words, INFO_NAME, robot_name)
    _write_text(words, INFO_LAW, law)


def describe_law(words: Words, law: str) -> None:
    """Tell readers that another law is in force. Raises ConfigError when its name does not fit."""
    _write_text(words, INFO_LAW, law)


def describe_choices(words: Words, velocity: str, interpolation: str) -> None:
    """Add to the INFO block how velocities are estimated and setpoints interpolated. Raises ValueError for others."""
    words[INFO_ESTIMATOR] = 1 + list(ESTIMATORS).index(velocity)
    words[INFO_FORM] = 1 + list(FORMS).index(interpolation)


def _nth(names: Iterable[str], word: int) -> str:
    """The choice told by a word; "" when it is not told, or nonsense."""
    choices = ("", *names)
    return choices[word] if 0 <= word < len(choices) else ""


def create_servo_memory(
    arm: str, robot_name: str, law: str, n: int, period_ns: int, telemetry_capacity: int
) -> SharedMemory:
    """Own the servo memory of `arm`. Raises LinkBusy when another servo runs that arm."""
    segment = SharedMemory.create(f"{arm}-servo", LAYOUT, memory_words(n, telemetry_capacity))
    describe_servo(segment.words, robot_name, law, n, period_ns, telemetry_capacity)
    return segment


def attach_servo_memory(arm: str) -> SharedMemory:
    """Map the servo memory of `arm`. Raises LinkError when no servo serves it."""
    return SharedMemory.attach(f"{arm}-servo", LAYOUT, "the arm with `qrobot up`, or its servo with `qrobot servo`")


def local_servo_memory(robot_name: str, law: str, n: int, period_ns: int, telemetry_capacity: int) -> Words:
    """Servo memory inside this process, for lock-step and tests."""
    words = np.zeros(memory_words(n, telemetry_capacity), dtype=np.int64)
    header = record_in(words, HEADER)
    header.magic, header.generation = MAGIC_VALUE, 1
    describe_servo(words, robot_name, law, n, period_ns, telemetry_capacity)
    return words


def servo_info(words: Words) -> ServoInfo:
    """Read the INFO block, of a servo that is just starting a moment later.

    Raises LinkError when it contradicts the memory it stands in: somebody has spoilt it.
    """
    for _ in range(_START_TRIES):  # the owner has zeroed the memory and is about to say what it is
        if words[INFO_JOINTS] != 0 or words[INFO_PERIOD_NS] != 0:
            break
        time.sleep(_READ_PAUSE_S)
    _insist_on_sense(words)
    return ServoInfo(
        robot_name=_read_text(words, INFO_NAME),
        law=_read_text(words, INFO_LAW),
        n=int(words[INFO_JOINTS]),
        period_ns=int(words[INFO_PERIOD_NS]),
        generation=int(record_in(words, HEADER).generation),
        telemetry_base=int(words[INFO_TELEMETRY_BASE]),
        telemetry_capacity=int(words[INFO_TELEMETRY_CAPACITY]),
        ready=bool(words[INFO_READY]),
        velocity=_nth(ESTIMATORS, words[INFO_ESTIMATOR]),
        interpolation=_nth(FORMS, words[INFO_FORM]),
    )


def _insist_on_sense(words: Words) -> None:
    """Whoever believed a wrong joint count or place of the ring would read beyond the memory."""
    n, period_ns = int(words[INFO_JOINTS]), int(words[INFO_PERIOD_NS])
    base, capacity = int(words[INFO_TELEMETRY_BASE]), int(words[INFO_TELEMETRY_CAPACITY])
    sane = 1 <= n <= MAX_JOINTS and period_ns > 0 and base == _telemetry_base(n)
    if not sane or capacity < 1 or capacity & (capacity - 1) or words.size != memory_words(n, capacity):
        raise LinkError(
            f"the servo memory is damaged: {n} joints, period {period_ns} ns, {capacity} rows from word {base} on, "
            f"in {words.size} words; restart the servo"
        )


@dataclass(frozen=True)
class ServoSnapshot:
    """The servo's state at one tick. Vectors have shape (n,), SI units; `force` has shape (6,), N and N m."""

    t_ns: int
    tick: int
    mode: int
    fault: int
    event: int
    joint: int
    flags: int
    setpoint_seq: int
    missed_frames: int
    late_cycles: int
    inputs: int
    hand: int
    outputs: int
    q: NDArray[np.float64]
    v: NDArray[np.float64]
    tau: NDArray[np.float64]
    q_ref: NDArray[np.float64]
    force: NDArray[np.float64]


_SCALARS: Final = tuple(field.name for field in fields(ServoSnapshot))[:STATE_VECTORS]  # in the order of the block


@dataclass(frozen=True)
class CalibrationProgress:
    """A calibration as it stands; read word by word, so a tick may show between two of them.

    Attributes:
        stage: a `servo.calibration.state.Stage`. joint: which one is at work. found: its index pulses so far.
        wanted: how many are wanted. misfit: mean distance from the table's rows, ADC units. Shape (n,).
        margin: by how much the second best place in the table is worse. Shape (n,).
        votes: index pulses that agree with the place found. Shape (n,).
    """

    stage: int
    joint: int
    found: int
    wanted: int
    misfit: NDArray[np.float64]
    margin: NDArray[np.float64]
    votes: NDArray[np.int64]


class ServoMailbox:
    """The commander's and the readers' side of the servo memory, in Python."""

    def __init__(self, words: Words) -> None:
        self.words = words
        self.info = servo_info(words)
        n = self.info.n
        self._frame = np.zeros(frame_words(n), dtype=np.int64)
        self._frame_f = self._frame.view(np.float64)

    def push_setpoint(
        self, stream: int, seq: int, t_ns: int, period_ns: int, modes: Sequence[int], values: Sequence[float]
    ) -> bool:
        """Queue one frame for the servo; False when the queue is full (the servo does not take them).

        Args:
            stream: names one run of setpoints; after a stop the servo follows only a new stream.
            seq: counts up by one per sample period of the stream.
            t_ns: time of arrival, on the servo's clock.
            period_ns: sample period of the stream.
            modes: POSITION_SETPOINT, TORQUE_SETPOINT or 0 (hold). Shape (n,).
            values: rad or m for positions, N m or N for torques. Shape (n,).
        """
        frame, n = self._frame, self.info.n
        frame[:FRAME_JOINTS] = stream, seq, t_ns, period_ns
        frame[FRAME_JOINTS : FRAME_JOINTS + n] = modes
        self._frame_f[FRAME_JOINTS + n :] = values
        return bool(push_frame(self.words, frame, frame.size))

    def request_power(self, on: bool) -> None:
        """Ask for arm power, or for a controlled stop and power off."""
        self.words[COMMAND_POWER] = int(on)

    def request_power_off(self) -> None:
        """Take arm power away after a controlled stop, against the commander's wish too: they have to ask anew.

        Counters of requests have several writers here; two at once are seen as one, which is all the same.
        """
        self.words[COMMAND_OFFS] += 1

    def request_clear(self) -> None:
        """Ask to leave FAULT for OFF; refused while the cause persists."""
        self.words[COMMAND_CLEARS] += 1

    def request_stop(self) -> None:
        """Ask for a category 2 stop on the path."""
        self.words[COMMAND_STOPS] += 1

    def request_calibration(self, indexes: int = 0) -> None:
        """Ask an uncalibrated, powered arm to calibrate itself over so many index pulses a joint; 0: the default."""
        self.words[COMMAND_INDEXES] = indexes
        self.words[COMMAND_CALIBRATE] += 1

    def calibration(self) -> CalibrationProgress:
        """How far a calibration is, and what it found."""
        n, words = self.info.n, self.words
        base = calibration_base(n)
        found = words[base : base + CALIBRATION_FIELDS * n].reshape(CALIBRATION_FIELDS, n)
        misfit, margin = found[:2].view(np.float64).copy()
        stage, joint, indexes, wanted = words[CALIBRATION_STAGE : CALIBRATION_WANTED + 1].tolist()
        return CalibrationProgress(stage, joint, indexes, wanted, misfit, margin, found[2].copy())

    def request_hand(self, hand: int) -> None:
        """0 relaxes, 1 opens, 2 closes the hand."""
        self.words[COMMAND_HAND] = hand

    def request_outputs(self, outputs: int, t_ns: int) -> None:
        """What the outputs are to be, output 1 in bit 0, said at `t_ns` of the servo's clock.

        It has to be said again and again: see `servo.output_lines.OUTPUT_PATIENCE_NS`.
        """
        self.words[COMMAND_OUTPUTS_NS] = t_ns  # first: what is new must not be locked for what was silent before
        self.words[COMMAND_OUTPUTS] = outputs

    def snapshot(self) -> ServoSnapshot:
        """Newest state, for any thread. Raises LinkError when the servo died while writing it."""
        n = self.info.n
        words = np.zeros(state_words(n), dtype=np.int64)
        for _ in range(_READ_TRIES):
            if read_state(self.words, n, words):
                break
            time.sleep(_READ_PAUSE_S)  # its processor was taken from it inside the write: that may last a while
        else:
            raise LinkError("the servo's state cannot be read: it died while writing")
        floats = words.view(np.float64)
        vectors = floats[STATE_VECTORS : STATE_VECTORS + 4 * n].reshape(4, n).copy()
        force = floats[STATE_VECTORS + 4 * n :].copy()
        q, v, tau, q_ref = vectors
        numbers = dict(zip(_SCALARS, words[:STATE_VECTORS].tolist(), strict=True))
        return ServoSnapshot(**numbers, q=q, v=v, tau=tau, q_ref=q_ref, force=force)


@lean_kernel
def append_telemetry(words: Any, n: int, row: Any) -> None:
    """Servo: append a row to the ring, which stands where the number of joints says, and reaches to the end."""
    base = (
        QUEUE_START + QUEUE_CAPACITY * (FRAME_JOINTS + 2 * n) + 8
        + STATE_VECTORS + 4 * n + FORCE_AXES + 8
        + CALIBRATION_FIELDS * n + 8
        + RING_HEADER_WORDS + ENTRIES * entry_words(n) + 8
    )  # fmt: skip
    append_row(words, base, ring_capacity(words.size, base, row.size), row.size, row)


@lean_kernel
def publish_state(words: Any, n: int, state: Any) -> None:
    """Servo: publish the state block, int64[state_words(n)]."""
    seq = QUEUE_START + QUEUE_CAPACITY * (FRAME_JOINTS + 2 * n)
    seqlock_write(words, seq, seq + 8, state, STATE_VECTORS + 4 * n + FORCE_AXES)


@lean_kernel
def publish_calibration(words: Any, n: int, calibration: Any, stage: int, joint: int, found: int, wanted: int) -> None:
    """Servo: tell how far a calibration is. `calibration` has `misfit`, `margin` and `votes`, shapes (n,)."""
    words[CALIBRATION_STAGE], words[CALIBRATION_JOINT] = stage, joint
    words[CALIBRATION_FOUND], words[CALIBRATION_WANTED] = found, wanted
    base = QUEUE_START + QUEUE_CAPACITY * (FRAME_JOINTS + 2 * n) + 8 + STATE_VECTORS + 4 * n + FORCE_AXES + 8
    for j in range(n):
        words[base + j] = float_bits(calibration.misfit[j])
        words[base + n + j] = float_bits(calibration.margin[j])
        words[base + 2 * n + j] = calibration.votes[j]


@lean_kernel
def read_state(words: Any, n: int, out: Any) -> bool:
    """Reader: copy the newest whole state block into `out`; False when none could be had."""
    seq = QUEUE_START + QUEUE_CAPACITY * (FRAME_JOINTS + 2 * n)
    return seqlock_read(words, seq, seq + 8, out, STATE_VECTORS + 4 * n + FORCE_AXES)
