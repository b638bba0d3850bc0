"""Servo memory: the one layout through which the servo, its guardian, the bridge and the log meet, without locks.

Who may write what:

* info, calibration, its results, heartbeat, the published state, the journal and the telemetry ring: the servo alone;
* guardian: the guardian alone (its heartbeat and the takeover mark);
* the setpoint queue: the bridge alone, for its commander;
* command: whoever holds the arm's authority (`servo.memory.commander_lock`): the bridge for its commander, the servo's
  own threads for an operator, `qrobot calibrate`. Without authority anybody may, through bridge or servo, ask for a
  stop or take power away (`stops`, `power_offs`), and an operator may set override, pause and collision thresholds.
  The servo's own process sets `shutdown`, from a signal handler too.

So a word of command may have several writers. Of a level the later one counts. What is to be done once is asked for by
a counter: however often the servo looks, it acts once on a number that is another than the last. It reads each counter
once in a cycle, and so remembers none that it has not acted upon. Counters are raised in one undivided step, so that
two who ask at once are both counted (`realtime.atomics.raise_by_one`). Where words belong together the methods of
`ServoMailbox` tell which is written first; that holds by the order of stores that x86 keeps.

Blocks with different writers share no cache line. `ServoFront` is what does not depend on the number of joints; the
telemetry ring stands behind the rest, and its rows are those of `servo.memory.telemetry`.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, Final

import numpy as np

from qrobot.arrays import Floats, Words
from qrobot.config.outputs import N_ANALOG_OUTPUTS, N_OUTPUTS
from qrobot.errors import ConfigError, LinkError, LinkMismatch
from qrobot.hwif.registers import N_ENCODERS
from qrobot.printable import printable
from qrobot.realtime.shared_memory import MAGIC_VALUE, SegmentHeader, SharedMemory
from qrobot.realtime.structure import (
    WORD_BYTES,
    digest_of,
    dtype_of,
    floats,
    number,
    offset_of,
    part,
    record_in,
    text,
    word,
    words,
)
from qrobot.servo.kernels.interpolation_polynomials import FORMS
from qrobot.servo.kernels.velocity import ESTIMATORS
from qrobot.servo.memory.law_history import LAW_BYTES, entry_dtype, journal_words
from qrobot.servo.memory.published_state import PublishedBlock
from qrobot.servo.memory.setpoint_queue import QueueBlock
from qrobot.servo.memory.telemetry import TelemetryLayout, ring_words
from qrobot.wire.vocabulary import N_SIGNALS, SIGNAL_NAME_BYTES

LAYOUT: Final = 7
PLACE_LAYOUT: Final = 1  # of the segment that keeps a second guardian away; it holds nothing
MAX_JOINTS: Final = 32
NAME_BYTES: Final = LAW_BYTES
_START_PAUSE_S: Final = 0.001
_START_TRIES: Final = 500


class InfoBlock:
    """Facts that are constant while a servo runs, but for `law`."""

    joints: int = word()
    period_ns: int = word()
    telemetry_base: int = word()  # word of the memory at which the ring begins
    telemetry_capacity: int = word()  # rows
    ready: int = word()  # 1 once the loop runs
    estimator: int = word()  # 1 + place in ESTIMATORS, 0 when not told
    form: int = word()  # 1 + place in FORMS, 0 when not told
    analog_min: Floats = floats(N_ANALOG_OUTPUTS)  # least volts of each analogue output; NaN for none
    analog_max: Floats = floats(N_ANALOG_OUTPUTS)  # and most
    robot_name: bytes = text(NAME_BYTES)
    law: bytes = text(NAME_BYTES)


class CalibrationBlock:
    """Progress of a calibration; the results of the joints stand in `CalibrationResults`."""

    stage: int = word()  # a `servo.calibration.state.Stage`
    joint: int = word()
    found: int = word()  # index pulses of that joint
    wanted: int = word()


class HeartbeatBlock:
    """The servo's heartbeat, and what the guardian has to know of it."""

    t_ns: int = word()  # when the last cycle began
    armed: int = word()  # 1 while the board may carry torque, power, or outputs that a stop ends: `guardian_arming`
    discrete: int = word()  # what of the DISCRETE register the guardian is to leave, but for power
    trips_seen: int = word()  # trips of the guardian that a clear has acknowledged
    lines: int = word()  # outputs that there are, output 1 in bit 0
    kept: int = word()  # of those that hold at a stop, those that are on
    analog: int = word()  # analogue outputs of modules that there are, output 1 in bit 0
    slips: int = word()  # 1: the arm's time is that of an emulated board, see `hwif.arm_clock`
    slipped_ns: int = word()  # how far it lies behind CLOCK_MONOTONIC


NOT_TAKEN, TAKEN, TAKING = range(3)  # values of the guardian's `takeover`; TAKING: it has not made the board safe yet


class GuardianBlock:
    """The guardian's heartbeat and its takeover."""

    t_ns: int = word()  # its heartbeat
    takeover: int = word()  # NOT_TAKEN, or the servo writes nothing more
    trips: int = word()  # how often it had to, since it started


class CommandBlock:
    """Requests of the commander; which of them others may make stands above."""

    power: int = word()  # 1: they want arm power
    power_ons: int = word()  # raised whenever `power` goes up, even if it was down only for less than a cycle
    clears: int = word()  # raised to clear a fault
    stops: int = word()  # raised to ask for a category 2 stop
    shutdown: int = word()  # 1: end the daemon after a controlled stop
    hand: int = word()  # 0 relaxed, 1 open, 2 closed
    calibrations: int = word()  # raised to ask for a calibration
    indexes: int = word()  # index pulses a joint for it, 0 for the default
    power_offs: int = word()  # raised to take power away, whatever `power` says until it goes up anew
    outputs: int = word()  # what they want of the outputs, output 1 in bit 0
    outputs_let_go: Words = words(N_OUTPUTS)  # raised when one goes down in `outputs`, even for less than a cycle
    outputs_ns: int = word()  # when they last said so, on the servo's clock
    held_stream: int = word()  # 1 + the stream that moves the arm only while a key is held; 0 for none
    held_ns: int = word()  # when they last said that the key is held, on the servo's clock
    override: float = number()  # the operator's speed override, 1 for the speed as programmed
    paused: int = word()  # 1: the operator wants motions to stand still on their path
    resumes: int = word()  # raised to let them go on, and an arm go back to its path, when `paused` was down already
    payloads: int = word()  # raised when another payload stands in the fields behind
    payload_mass: float = number()  # kg
    payload_centre: Floats = floats(3)  # m, in the frame of the flange
    payload_inertia: Floats = floats(6)  # kg m2, about that centre: xx yy zz xy xz yz
    collision_thresholds: Floats = floats(N_ENCODERS)  # N m (N) of a torque nobody commanded; 0 for the robot file's
    collision_reaction: int = word()  # 0: stop, 1: give way for a while, then hold
    collision_told: int = word()  # 1: a program told both of a collision; until it has gone
    program_signals: Floats = floats(N_SIGNALS)  # numbers that the program tells; NaN for none
    names_told: int = word()  # raised when the names behind have changed
    signal_names: bytes = text(SIGNAL_NAME_BYTES)  # of the program's numbers, a blank between two
    analog_told: Words = words(N_ANALOG_OUTPUTS)  # raised for each analogue output that has another value behind
    analog_volts: Floats = floats(N_ANALOG_OUTPUTS)  # what they want of the analogue outputs
    path_waits_ns: int = word()  # when a program said last that it waits to be led back to its path; 0: it does not


class ServoFront:
    """Blocks that have the same place in the memory of every servo."""

    header: Any = part(SegmentHeader)
    info: Any = part(InfoBlock, own_line=True)
    calibration: Any = part(CalibrationBlock, own_line=True)
    heartbeat: Any = part(HeartbeatBlock, own_line=True)
    guardian: Any = part(GuardianBlock, own_line=True)
    command: Any = part(CommandBlock, own_line=True)


class CalibrationResults:
    """Results of a calibration, one of each joint. Shape (n,)."""

    misfit: Floats = floats("n")
    margin: Floats = floats("n")
    votes: Words = words("n")


class ServoMemory(ServoFront):
    """The whole of it, for n joints, but for the telemetry ring behind."""

    queue: Any = part(QueueBlock, own_line=True)
    published: Any = part(PublishedBlock, own_line=True)
    results: Any = part(CalibrationResults, own_line=True)
    journal: Words = words("journal_words", own_line=True)  # of laws, see `servo.memory.law_history`


FRONT: Final = dtype_of(ServoFront)


@cache
def servo_dtype(n: int) -> np.dtype[Any]:
    """The type of the servo memory for `n` joints."""
    return dtype_of(ServoMemory, n=n, journal_words=journal_words(n))


@cache
def memory_digest() -> int:
    """Digest of all fields: of the memory, of a row of telemetry and of an entry of the journal, of two joints each."""
    parts = {"memory": servo_dtype(2), "row": TelemetryLayout(2).dtype, "entry": entry_dtype(2)}
    return digest_of(np.dtype(list(parts.items())))


def journal_base(n: int) -> int:
    """Word at which the journal of laws stands."""
    return offset_of(servo_dtype(n), "journal") // WORD_BYTES


def _telemetry_base(n: int) -> int:
    return servo_dtype(n).itemsize // WORD_BYTES


def memory_words(n: int, telemetry_capacity: int) -> int:
    """Size of the servo memory for `n` joints and a ring of `telemetry_capacity` rows."""
    return _telemetry_base(n) + ring_words(TelemetryLayout(n).row_words, telemetry_capacity)


@dataclass(frozen=True)
class ServoInfo:
    """Facts that a reader needs before it can read anything else; checked against the size of the memory."""

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


def servo_front(memory: Words) -> ServoFront:
    """The blocks that have their place in every servo memory. Raises LinkError when it is cut off."""
    if memory.size < FRONT.itemsize // WORD_BYTES:
        raise LinkError("the servo memory is cut off: restart the servo")
    front: ServoFront = record_in(memory, FRONT)
    return front


def servo_record(memory: Words, n: int) -> ServoMemory:
    """A servo memory of `n` joints as a record."""
    record: ServoMemory = record_in(memory, servo_dtype(n))
    return record


def telemetry_ring(memory: Words, n: int) -> Words:
    """The words of the telemetry ring, to the end of the memory."""
    return memory[_telemetry_base(n) :]


class ServoSegment(SharedMemory):
    """Servo memory in a file, mapped."""

    @cached_property
    def front(self) -> ServoFront:
        """The blocks that do not depend on the number of joints. Raises LinkError when the file is cut off."""
        return servo_front(self.words)


def _name(name: str) -> bytes:
    data = name.encode()
    if len(data) > NAME_BYTES:
        raise ConfigError(f"name {name!r} is longer than {NAME_BYTES} bytes")
    return data


def _read_name(data: bytes) -> str:
    return printable(bytes(data).decode(errors="replace"))


def describe_servo(memory: Words, robot_name: str, law: str, n: int, period_ns: int, telemetry_capacity: int) -> None:
    """Fill the info block. Raises ConfigError for names or joint counts that do not fit."""
    if not 1 <= n <= MAX_JOINTS:
        raise ConfigError(f"{n} joints: this servo takes 1 to {MAX_JOINTS}")
    info = servo_front(memory).info
    info.joints = n
    info.telemetry_base, info.telemetry_capacity = _telemetry_base(n), telemetry_capacity
    info.robot_name, info.law = _name(robot_name), _name(law)
    info.analog_min[:] = info.analog_max[:] = np.nan
    command = servo_front(memory).command
    command.override, command.program_signals[:] = 1.0, np.nan
    info.period_ns = period_ns  # last: `servo_info` waits for it


def describe_law(memory: Words, law: str) -> None:
    """Tell readers that another law is in force. Raises ConfigError when its name does not fit."""
    servo_front(memory).info.law = _name(law)


def describe_choices(memory: Words, velocity: str, interpolation: str) -> None:
    """Add to the info how velocities are estimated and setpoints interpolated. Raises ValueError for others."""
    info = servo_front(memory).info
    info.estimator, info.form = 1 + list(ESTIMATORS).index(velocity), 1 + list(FORMS).index(interpolation)


def describe_analog_outputs(memory: Words, ranges: Mapping[int, tuple[float, float]]) -> None:
    """Add to the info the least and most volts of the analogue outputs, by their numbers from 1."""
    info = servo_front(memory).info
    for output, (least, most) in ranges.items():
        info.analog_min[output - 1], info.analog_max[output - 1] = least, most


def _nth(names: Iterable[str], place: int) -> str:
    """The choice told by a field; "" when it is not told, or nonsense."""
    choices = ("", *names)
    return choices[place] if 0 <= place < len(choices) else ""


def create_servo_memory(
    arm: str, robot_name: str, law: str, n: int, period_ns: int, telemetry_capacity: int
) -> ServoSegment:
    """Own the servo memory of `arm`. Raises LinkBusy when another servo runs that arm."""
    segment = ServoSegment.create(f"{arm}-servo", LAYOUT, memory_words(n, telemetry_capacity), memory_digest())
    describe_servo(segment.words, robot_name, law, n, period_ns, telemetry_capacity)
    return segment


def attach_servo_memory(arm: str) -> ServoSegment:
    """Map the servo memory of `arm`. Raises LinkError when no servo serves it."""
    start = "the arm with `qrobot up`, or its servo with `qrobot servo`"
    return ServoSegment.attach(f"{arm}-servo", LAYOUT, start, memory_digest())


def arm_is_driven(arm: str) -> bool:
    """A living servo of `arm` drives it, or has not seen yet that its board has taken torque and power away.

    A living one of other code may.
    """
    try:
        with attach_servo_memory(arm) as segment:
            return segment.owner_alive and bool(segment.front.heartbeat.armed)
    except LinkMismatch:
        return True
    except LinkError:
        return False


def guardian_place(arm: str) -> str:
    """Name of the segment that the guardian of `arm` owns, so that there is one."""
    return f"{arm}-guardian"


def local_servo_memory(robot_name: str, law: str, n: int, period_ns: int, telemetry_capacity: int) -> Words:
    """Servo memory inside this process, for lock-step and tests."""
    memory = np.zeros(memory_words(n, telemetry_capacity), dtype=np.int64)
    describe_servo(memory, robot_name, law, n, period_ns, telemetry_capacity)
    header = servo_front(memory).header
    header.magic, header.generation = MAGIC_VALUE, 1
    return memory


def servo_info(memory: Words) -> ServoInfo:
    """Read the info block, of a servo that is just starting a moment later.

    Raises LinkError when it contradicts the memory it stands in: somebody has spoilt it.
    """
    front = servo_front(memory)
    for _ in range(_START_TRIES):  # the owner has zeroed the memory and is about to say what it is
        if front.info.period_ns != 0:
            break
        time.sleep(_START_PAUSE_S)
    _insist_on_sense(memory, front.info)
    info = front.info
    return ServoInfo(
        robot_name=_read_name(info.robot_name),
        law=_read_name(info.law),
        n=int(info.joints),
        period_ns=int(info.period_ns),
        generation=int(front.header.generation),
        telemetry_base=int(info.telemetry_base),
        telemetry_capacity=int(info.telemetry_capacity),
        ready=bool(info.ready),
        velocity=_nth(ESTIMATORS, int(info.estimator)),
        interpolation=_nth(FORMS, int(info.form)),
    )


def _insist_on_sense(memory: Words, info: InfoBlock) -> None:
    """Refuse a wrong joint count or place of the ring: whoever believed it would read beyond the memory."""
    n, period_ns = int(info.joints), int(info.period_ns)
    base, capacity = int(info.telemetry_base), int(info.telemetry_capacity)
    sane = 1 <= n <= MAX_JOINTS and period_ns > 0 and base == _telemetry_base(n)
    if not sane or capacity < 1 or capacity & (capacity - 1) or memory.size != memory_words(n, capacity):
        raise LinkError(
            f"the servo memory is damaged: {n} joints, period {period_ns} ns, {capacity} rows from word {base} on, "
            f"in {memory.size} words; restart the servo"
        )
