"""Words of the servo memory that somebody has spoilt: no reader and no loop follows them out of the memory."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.arrays import Words
from qrobot.errors import LinkError
from qrobot.modecodes import Mode
from qrobot.realtime.structure import WORD_BYTES, local_record, offset_of, view_words
from qrobot.servo.memory.servo_memory import (
    FRONT,
    local_servo_memory,
    servo_front,
    servo_info,
    servo_record,
    telemetry_ring,
)
from qrobot.servo.memory.setpoint_queue import QUEUE_CAPACITY, make_frame, peek_frame
from qrobot.servo.memory.telemetry import TelemetryLayout, TelemetryReader, append_telemetry
from tests.support.servo_bench import ServoBench

N, ROWS = 6, 16
WILD = st.integers(-(2**63), 2**63 - 1)
FLOATS = (float("nan"), float("inf"), float("-inf"), 1e300, -1e300, -5.0)
NONSENSE = [0, -1, 2**62, -(2**63), *(int(np.float64(value).view(np.int64)) for value in FLOATS)]
SAID = range(offset_of(FRONT, "calibration") // WORD_BYTES, FRONT.itemsize // WORD_BYTES)  # behind header and facts


def append_telemetry_row(words: Words, fill: int) -> None:
    row = local_record(TelemetryLayout(N).source_dtype)
    view_words(row)[:] = fill
    append_telemetry(telemetry_ring(words, N), row)


@given(WILD, WILD)
def test_a_queue_that_cannot_be_is_emptied_at_once(head: int, tail: int) -> None:
    mail, frame = servo_record(local_servo_memory("puma560", "pd", N, 1_000_000, ROWS), N), make_frame(N)
    mail.queue.head, mail.queue.tail = head, tail
    waits = 0 < head - tail <= QUEUE_CAPACITY
    assert bool(peek_frame(mail, frame)) == waits or abs(head - tail) >= 2**63
    assert waits or mail.queue.tail == head or abs(head - tail) >= 2**63


@given(st.sampled_from(["joints", "telemetry_base", "telemetry_capacity"]), WILD)
def test_a_reader_refuses_what_contradicts_the_memory_and_the_loop_does_not_look(name: str, value: int) -> None:
    words = local_servo_memory("puma560", "pd", N, 1_000_000, ROWS)
    told, info = servo_info(words), servo_front(words).info
    right, info[name] = int(info[name]), value
    append_telemetry_row(words, 7)
    if value != right:
        with pytest.raises(LinkError, match="damaged"):
            servo_info(words)
    rows = TelemetryReader(words, told.telemetry_base, told.telemetry_capacity, N).read()
    assert rows["tick"].tolist() == [7]


@pytest.mark.sampled(4)
@pytest.mark.parametrize("counter", ["", "payloads"])
@pytest.mark.parametrize("value", NONSENSE)
def test_whatever_another_has_written_the_loop_keeps_its_torques_and_its_reference_within_their_limits(
    value: int, counter: str
) -> None:
    """Each of the words of commander, operator and guardian, under power; a payload is looked at when it is told."""
    for place in SAID:
        bench = ServoBench().hold()
        bench.mailbox.words[place] = value
        if counter:
            bench.mailbox.memory.command[counter] += 1
        limits = bench.robot.limits
        for _ in range(4):
            bench.tick()
            assert (np.abs(bench.state.tau) <= np.array(bench.robot.guard.tau_max)).all(), place
            assert (bench.state.q_ref >= limits.q_min).all(), place
            assert (bench.state.q_ref <= limits.q_max).all(), place
            assert bench.mode in Mode


def test_a_choice_that_is_nonsense_reads_as_not_told() -> None:
    words = local_servo_memory("puma560", "pd", N, 1_000_000, ROWS)
    servo_front(words).info.estimator = 1 << 40
    assert servo_info(words).velocity == ""
