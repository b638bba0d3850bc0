"""The commander's and the readers' side of the servo memory (`servo.memory.servo_memory`), in Python."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from qrobot.arrays import Floats, Ints, Words
from qrobot.config.outputs import N_OUTPUTS
from qrobot.errors import LinkError
from qrobot.hwif.registers import N_ENCODERS
from qrobot.printable import printable
from qrobot.realtime.atomics import raise_by_one
from qrobot.realtime.flat_record import block_of
from qrobot.realtime.jit import lean_kernel
from qrobot.realtime.structure import WORD_BYTES, offset_of
from qrobot.servo.memory.published_state import ServoSnapshot, read_state, snapshot_of, state_dtype
from qrobot.servo.memory.servo_memory import FRONT, servo_info, servo_record, telemetry_ring
from qrobot.servo.memory.setpoint_queue import make_frame, push_block
from qrobot.wire import Payload

_READ_TRIES: Final = 20
WAITING_NS: Final = 500_000_000  # what a program said so long ago of its path does not count: it is gone [A]
_READ_PAUSE_S: Final = 0.001


@lean_kernel
def raise_word(words: Words, place: int) -> None:
    """Raise a word of the memory by one, whoever raises it beside us."""
    raise_by_one(words, place)


@cache
def _place_of(counter: str) -> int:
    """The word at which a counter of the block of commands stands."""
    return offset_of(FRONT, f"command.{counter}") // WORD_BYTES


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
    misfit: Floats
    margin: Floats
    votes: Ints


class ServoMailbox:
    """A servo memory, for commanding and looking.

    Attributes:
        words: all of it. memory: the same as a record. ring: the words of its telemetry ring. info: what it is.
    """

    def __init__(self, words: Words) -> None:
        self.words = words
        self.info = servo_info(words)
        n = self.info.n
        self.memory = servo_record(words, n)
        self.ring = telemetry_ring(words, n)
        self._frame = make_frame(n)
        self._block, self._frame_block = block_of(self.memory), block_of(self._frame)
        self._state_words = state_dtype(n).itemsize // WORD_BYTES
        raise_word(np.zeros(1, np.int64), 0)  # compiles, or loads, what a stop must not wait for

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
        frame = self._frame
        frame.stream, frame.seq, frame.t_ns, frame.period_ns = stream, seq, t_ns, period_ns
        frame.modes[:], frame.values[:] = modes, values
        return bool(push_block(self._block, self._frame_block))

    def request_power(self, on: bool) -> None:
        """Ask for arm power, or for a controlled stop and power off."""
        command = self.memory.command
        if on and command.power == 0:
            self._raise("power_ons")  # first: with the level alone the request would be one that stood already
        command.power = int(on)

    def request_power_off(self) -> None:
        """Take arm power away after a controlled stop, against the commander's wish too: they have to ask anew."""
        self._raise("power_offs")

    @property
    def halts(self) -> tuple[int, int]:
        """Numbers of the stops and of the power-offs that somebody has asked for so far."""
        return int(self.memory.command.stops), int(self.memory.command.power_offs)

    def request_override(self, override: float) -> None:
        """Ask for motions at `override` times their programmed speed, 0 to `wire.vocabulary.LARGEST_OVERRIDE`."""
        self.memory.command.override = override

    def request_pause(self, paused: bool) -> None:
        """Ask for motions to stand still on their path, or to go on."""
        self.memory.command.paused = int(paused)

    def request_resume(self) -> None:
        """End the pause; where there is none let programs hear of one that ends, see `servo.stages.override`."""
        command = self.memory.command
        if command.paused == 0:
            self._raise("resumes")
        command.paused = 0

    def tell_path_waits(self, t_ns: int) -> None:
        """A program waits to be led back to its path, as it said at `t_ns` of the servo's clock; 0: it does not."""
        self.memory.command.path_waits_ns = t_ns

    def path_waits(self, now_ns: int) -> bool:
        """True while a program says that it waits to be led back to its path."""
        said_ns = int(self.memory.command.path_waits_ns)
        return said_ns > 0 and abs(now_ns - said_ns) < WAITING_NS

    def request_payload(self, payload: Payload) -> None:
        """Reckon with `payload` from now on; see `model.payload_judge` for what an arm can carry."""
        command = self.memory.command
        command.payload_mass = payload.mass
        command.payload_centre[:], command.payload_inertia[:] = payload.centre, payload.inertia
        self._raise("payloads")  # last: what is read after it is whole

    def request_collision(self, thresholds: Sequence[float], reaction: int, by_program: bool = False) -> None:
        """Ask for other thresholds of a collision, N m (N), 0 for the robot file's, and for what follows it."""
        command = self.memory.command
        wanted = np.zeros(N_ENCODERS)
        wanted[: len(thresholds)] = thresholds
        command.collision_thresholds[:] = wanted  # at once: a cycle in between would tell by the robot file's
        command.collision_reaction = reaction
        command.collision_told = int(by_program)

    def forget_collision(self) -> None:
        """Let the robot file's thresholds count again where a program asked for others: it has gone."""
        if self.memory.command.collision_told:
            self.request_collision((), 0)

    def tell_signals(self, numbers: Sequence[float]) -> None:
        """Numbers that the program tells, NaN for none. Shape (8,)."""
        self.memory.command.program_signals[:] = numbers

    def name_signals(self, names: Sequence[str]) -> None:
        """Names of the program's numbers from now on, in their order."""
        command = self.memory.command
        command.signal_names = " ".join(names).encode()
        self._raise("names_told")

    def signal_names(self) -> tuple[str, ...]:
        """Names of the program's numbers."""
        return tuple(printable(bytes(self.memory.command.signal_names).decode(errors="replace")).split())

    def request_clear(self) -> None:
        """Ask to leave FAULT for OFF; refused while the cause persists."""
        self._raise("clears")

    def request_stop(self) -> None:
        """Ask for a category 2 stop on the path."""
        self._raise("stops")

    def request_calibration(self, indexes: int = 0) -> None:
        """Ask an uncalibrated, powered arm to calibrate itself over so many index pulses a joint; 0: the default."""
        command = self.memory.command
        command.indexes = indexes
        self._raise("calibrations")

    def calibration(self) -> CalibrationProgress:
        """Progress and results of a calibration."""
        now, results = self.memory.calibration, self.memory.results
        return CalibrationProgress(
            stage=int(now.stage),
            joint=int(now.joint),
            found=int(now.found),
            wanted=int(now.wanted),
            misfit=np.array(results.misfit),
            margin=np.array(results.margin),
            votes=np.array(results.votes),
        )

    def request_hand(self, hand: int) -> None:
        """0 relaxes, 1 opens, 2 closes the hand."""
        self.memory.command.hand = hand

    def request_outputs(self, outputs: int, t_ns: int) -> None:
        """Ask for levels of the outputs, output 1 in bit 0, at `t_ns` of the servo's clock.

        It has to be said again and again: see `servo.output_lines.OUTPUT_PATIENCE_NS`.
        """
        command = self.memory.command
        command.outputs_ns = t_ns  # first: what is new must not be locked for what was silent before
        let_go = int(command.outputs) & ~outputs
        command.outputs = outputs
        for k in range(N_OUTPUTS):  # told behind the level: a lock that opens before it would switch the line on
            if let_go >> k & 1:
                self._raise("outputs_let_go", k)

    def analog_objection(self, volts: Sequence[float]) -> str:
        """Reason for which analogue outputs cannot show these volts, NaN for none; "" when they can. Shape (8,)."""
        info = self.memory.info
        for k, asked in enumerate(volts):
            least, most = float(info.analog_min[k]), float(info.analog_max[k])
            if math.isnan(asked):
                continue
            if math.isnan(least):
                return f"there is no analogue output {k + 1}; see [[arm.board.analog_outputs]] of the deployment file"
            if not least <= asked <= most:
                return f"analogue output {k + 1}: {asked:g} V is not within {least:g} to {most:g} V"
        return ""

    def request_analog(self, volts: Sequence[float]) -> None:
        """Ask for volts of the analogue outputs, NaN for those that stay as they are. Shape (8,)."""
        command = self.memory.command
        for k, asked in enumerate(volts):
            if not math.isnan(asked):
                command.analog_volts[k] = asked
                self._raise("analog_told", k)  # last: what is read after it is whole

    def _raise(self, counter: str, k: int = 0) -> None:
        """Raise a counter of the block of commands, or element `k` of it."""
        raise_word(self.words, _place_of(counter) + k)

    def snapshot(self) -> ServoSnapshot:
        """Newest state, for any thread. Raises LinkError when the servo died while writing it."""
        words = np.zeros(self._state_words, dtype=np.int64)
        for _ in range(_READ_TRIES):
            if read_state(self._block, words):
                return snapshot_of(words, self.info.n)
            time.sleep(_READ_PAUSE_S)  # its processor was taken from it inside the write: that may last a while
        raise LinkError("the servo's state cannot be read: it died while writing")
