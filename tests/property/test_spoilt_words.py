"""Words of the servo memory that somebody has spoilt: no reader and no loop follows them out of the memory."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.errors import LinkError
from qrobot.servo.memory.mailbox import (
    INFO_ESTIMATOR,
    INFO_JOINTS,
    INFO_TELEMETRY_BASE,
    INFO_TELEMETRY_CAPACITY,
    append_telemetry,
    local_servo_memory,
    servo_info,
)
from qrobot.servo.memory.setpoint_queue import QUEUE_CAPACITY, QUEUE_HEAD, QUEUE_TAIL, frame_words, peek_frame
from qrobot.servo.memory.telemetry import TelemetryLayout, TelemetryReader

N, ROWS = 6, 16
WILD = st.integers(-(2**63), 2**63 - 1)


@given(WILD, WILD)
def test_a_queue_that_cannot_be_is_emptied_at_once(head: int, tail: int) -> None:
    words, frame = local_servo_memory("puma560", "pd", N, 1_000_000, ROWS), np.zeros(frame_words(N), dtype=np.int64)
    words[QUEUE_HEAD], words[QUEUE_TAIL] = head, tail
    waits = 0 < head - tail <= QUEUE_CAPACITY
    assert bool(peek_frame(words, frame, frame.size)) == waits or abs(head - tail) >= 2**63
    assert waits or words[QUEUE_TAIL] == head or abs(head - tail) >= 2**63


@given(st.sampled_from([INFO_JOINTS, INFO_TELEMETRY_BASE, INFO_TELEMETRY_CAPACITY]), WILD)
def test_a_reader_refuses_what_contradicts_the_memory_and_the_loop_does_not_look(at: int, value: int) -> None:
    words = local_servo_memory("puma560", "pd", N, 1_000_000, ROWS)
    told, right = servo_info(words), int(words[at])
    words[at] = value
    append_telemetry(words, N, np.full(TelemetryLayout(N).row_words, 7, dtype=np.int64))
    if value != right:
        with pytest.raises(LinkError, match="damaged"):
            servo_info(words)
    rows = TelemetryReader(words, told.telemetry_base, told.telemetry_capacity, N).read()
    assert rows["tick"].tolist() == [7]


def test_a_choice_that_is_nonsense_reads_as_not_told() -> None:
    words = local_servo_memory("puma560", "pd", N, 1_000_000, ROWS)
    words[INFO_ESTIMATOR] = 1 << 40
    assert servo_info(words).velocity == ""
