"""Lost counts, found at the next index pulse: while a calibrated arm is in use its index latches stay armed.

Every index pulse of a joint lies at one place of the motor turn, `index_phase` of the robot file. A latched count that
is off by more than `LOST_COUNTS` means that the counter has lost or gained some: ENC_LOSS, and the counters are not
calibrated any more. Only with a calibration table, whose phases have been checked against the robot file.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from qrobot.faultcodes import NO_JOINT, FaultCode
from qrobot.hwif.image import IMAGE_ENC_INDEX
from qrobot.hwif.operations import put_write
from qrobot.hwif.registers import DISCRETE, INDEX_BIT_0
from qrobot.model.transmission import signed_word
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.kernels.awaited import Awaited
from qrobot.servo.kernels.converter import await_answer, is_answered

ENC_LOSS: Final = int(FaultCode.ENC_LOSS)
LOST_COUNTS: Final = 3  # an edge of the index pulse may come a count or two early or late


@dataclass(eq=False)
class IndexWatch:
    """State of the watch."""

    awaited: Awaited  # the first image whose flags count
    armed: int = 0  # bits of the latches that are armed, as in DISCRETE
    rearm: int = 0  # bits of those to arm in this cycle


def make_index_watch() -> IndexWatch:
    """State of a joint whose index pulse is not waited for."""
    return IndexWatch(Awaited())


@lean_kernel
def off_phase(count: int, phase: int, turn: int) -> int:
    """Counts by which an index pulse at `count` is off its place, from -turn/2 to turn/2."""
    return (count - phase + turn // 2) % turn - turn // 2


@lean_kernel
def check_indexes(transmission: Any, phase: Any, state: Any, status: int) -> tuple[int, int]:
    """(code, joint): index pulses seen in the newest image lie where they have to. Has the latches armed as is due.

    Args:
        transmission: `TransmissionParams`. phase: index pulse modulo counts_per_rev, int64[n]. state: `ServoState`.
        status: STATUS of its image.
    """
    watch, n = state.index_watch, state.raw.size
    every = ((1 << n) - 1) * INDEX_BIT_0
    seen = watch.armed & ~status & every
    watch.rearm = every & ~watch.armed
    counts = is_answered(watch.awaited, state.adc, state.image, state.image_taken_ns)
    if seen == 0 or not counts:
        return 0, NO_JOINT
    watch.rearm |= seen
    for j in range(n):
        if seen & INDEX_BIT_0 << j:
            latched = state.image[IMAGE_ENC_INDEX + j]
            count = state.counts[j] + signed_word(latched - state.raw[j]) - transmission.count_offset[j]
            if abs(off_phase(count, phase[j], transmission.counts_per_rev[j])) > LOST_COUNTS:
                return ENC_LOSS, j
    return 0, NO_JOINT


@lean_kernel
def stop_watching(state: Any) -> None:
    """Let the latches be; whoever arms them next presets them first."""
    state.index_watch.armed, state.index_watch.rearm = 0, 0


@lean_kernel
def post_index_watch(state: Any, n: int, word: int) -> int:
    """Arm the latches that are due (mask 0, then 1) in DISCRETE `word`; returns the number of operations."""
    watch = state.index_watch
    if watch.rearm != 0:
        n = put_write(state.ops, n, DISCRETE, word & ~watch.rearm)
        n = put_write(state.ops, n, DISCRETE, word)
        watch.armed |= watch.rearm
        watch.rearm = 0
        await_answer(watch.awaited)
    return n
