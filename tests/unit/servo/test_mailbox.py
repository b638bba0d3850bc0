"""Servo memory: frames go in whole and in order, state comes out whole, requests are counted."""

from __future__ import annotations

import math
import os
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.errors import ConfigError, LinkError
from qrobot.realtime.structure import local_record, view_words
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.published_state import ROWS, publish_state, state_dtype
from qrobot.servo.memory.servo_memory import (
    MAX_JOINTS,
    arm_is_driven,
    create_servo_memory,
    describe_servo,
    local_servo_memory,
    memory_words,
    servo_dtype,
    servo_front,
    servo_info,
)
from qrobot.servo.memory.setpoint_queue import (
    QUEUE_CAPACITY,
    QueuedFrame,
    drop_all_frames,
    drop_frame,
    make_frame,
    peek_frame,
)
from qrobot.servo.memory.telemetry import TelemetryLayout, ring_words


def mailbox(n: int = 6, ring: int = 16) -> ServoMailbox:
    return ServoMailbox(local_servo_memory("puma560", "qrobot", n, 250_000, ring))


def push(box: ServoMailbox, seq: int, n: int = 6) -> bool:
    return box.push_setpoint(3, seq, 1000 + seq, 28_000_000, [1] * n, [0.1 * seq] * n)


def peek(box: ServoMailbox) -> QueuedFrame | None:
    frame = make_frame(box.info.n)
    return frame if peek_frame(box.memory, frame) else None


def test_the_info_block_says_what_a_reader_has_to_know() -> None:
    info = mailbox().info
    assert (info.robot_name, info.law, info.n, info.period_ns, info.rate_hz) == (
        "puma560",
        "qrobot",
        6,
        250_000,
        4000.0,
    )
    assert (info.telemetry_capacity, info.ready) == (16, False)


@pytest.mark.parametrize("n", [1, 6, MAX_JOINTS])
def test_the_telemetry_ring_is_the_last_thing_in_the_memory(n: int) -> None:
    box = mailbox(n)
    assert box.words.size == memory_words(n, 16)
    assert box.info.telemetry_base + ring_words(TelemetryLayout(n).row_words, 16) == box.words.size
    assert box.ring.size == ring_words(TelemetryLayout(n).row_words, 16)
    assert box.info.telemetry_base * 8 == servo_dtype(n).itemsize


@pytest.mark.parametrize("n", [0, MAX_JOINTS + 1])
def test_a_joint_count_that_does_not_fit_is_refused(n: int) -> None:
    with pytest.raises(ConfigError, match=f"{n} joints"):
        describe_servo(np.zeros(200, dtype=np.int64), "x", "pd", n, 1, 16)


def test_a_name_that_does_not_fit_is_refused_and_one_that_just_fits_comes_back() -> None:
    with pytest.raises(ConfigError, match="longer than 64 bytes"):
        local_servo_memory("ü" * 33, "pd", 1, 1, 16)
    assert servo_info(local_servo_memory("ü" * 32, "pd", 1, 1, 16)).robot_name == "ü" * 32


def test_a_reader_waits_for_a_servo_that_is_about_to_say_what_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    words = local_servo_memory("puma560", "pd", 6, 1_000_000, 16)
    info = servo_front(words).info
    info.period_ns = 0  # which is told last
    monkeypatch.setattr(time, "sleep", lambda _: setattr(info, "period_ns", 1_000_000))
    assert servo_info(words).period_ns == 1_000_000


@given(st.lists(st.floats(allow_nan=True), min_size=3, max_size=3), st.lists(st.integers(0, 2), min_size=3, max_size=3))
def test_a_frame_arrives_bit_for_bit(values: list[float], modes: list[int]) -> None:
    box = mailbox(3)
    assert box.push_setpoint(7, 8, 9, 10, modes, values)
    frame = peek(box)
    assert frame is not None
    assert [frame.stream, frame.seq, frame.t_ns, frame.period_ns] == [7, 8, 9, 10]
    assert list(frame.modes) == modes
    assert frame.values.tobytes() == np.array(values).tobytes()


def test_frames_come_out_in_order_and_stay_until_dropped() -> None:
    box = mailbox()
    assert peek(box) is None
    for seq in range(5):
        push(box, seq)
    for seq in range(5):
        for _ in range(2):
            frame = peek(box)
            assert frame is not None
            assert frame.seq == seq
        drop_frame(box.memory)
    assert peek(box) is None


def test_a_full_queue_takes_nothing_more_and_loses_nothing() -> None:
    box = mailbox()
    assert all(push(box, seq) for seq in range(QUEUE_CAPACITY))
    assert not push(box, QUEUE_CAPACITY)
    drop_frame(box.memory)
    assert push(box, QUEUE_CAPACITY)
    for seq in range(1, QUEUE_CAPACITY + 1):
        frame = peek(box)
        assert frame is not None
        assert frame.seq == seq
        drop_frame(box.memory)
    assert peek(box) is None


@given(st.lists(st.sampled_from(["push", "drop", "clear"]), max_size=300))
def test_the_queue_is_a_queue(steps: list[str]) -> None:
    box, model, seq = mailbox(1), list[int](), 0
    for step in steps:
        if step == "push":
            assert push(box, seq, 1) == (len(model) < QUEUE_CAPACITY)
            model += [seq] if len(model) < QUEUE_CAPACITY else []
            seq += 1
        elif step == "clear":
            drop_all_frames(box.memory)
            model.clear()
        elif model:
            drop_frame(box.memory)
            model.pop(0)
        frame = peek(box)
        assert (None if frame is None else frame.seq) == (model[0] if model else None)


def test_requests_are_levels_or_counts() -> None:
    box = mailbox()
    box.request_power(True)
    box.request_clear()
    box.request_clear()
    box.request_stop()
    box.request_hand(2)
    command = box.memory.command
    assert (command.power, command.clears, command.stops, command.hand) == (1, 2, 1, 2)
    box.request_power(False)
    assert command.power == 0


def test_the_state_is_read_as_it_was_published() -> None:
    box, state = mailbox(2), local_record(state_dtype(2))
    words = view_words(state)
    words[:] = np.arange(100, 100 + words.size)
    state.q[:] = (1.5, math.nan)
    publish_state(box.memory, state)
    seen = box.snapshot()
    for row in ROWS:
        np.testing.assert_array_equal(getattr(seen, row.name), state[row.source or row.name], err_msg=row.name)


def test_a_snapshot_is_a_copy() -> None:
    box, state = mailbox(1), local_record(state_dtype(1))
    publish_state(box.memory, state)
    before = box.snapshot()
    state.q[0] = 1.0
    publish_state(box.memory, state)
    assert before.q[0] == 0.0
    assert box.snapshot().q[0] == 1.0


def test_a_servo_that_died_while_writing_is_an_error_and_not_a_torn_state() -> None:
    box = mailbox(1)
    publish_state(box.memory, local_record(state_dtype(1)))
    box.memory.published.sequence += 1
    with pytest.raises(LinkError, match="died while writing"):
        box.snapshot()


@pytest.mark.parametrize("field", ["layout", "digest"])
def test_a_living_servo_of_other_code_may_drive_the_arm(field: str) -> None:
    """Its board stays beside it; whether it drives cannot be read."""
    arm = f"othercode{os.getpid()}"
    with create_servo_memory(arm, "puma560", "pd", 6, 1_000_000, 16) as servo:
        assert not arm_is_driven(arm)
        setattr(servo.header, field, getattr(servo.header, field) + 1)
        assert arm_is_driven(arm)
    assert not arm_is_driven(arm)
