"""Hold to run: an arm that moves only while a key is held stops when nothing is heard of the key."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot import rccl
from qrobot.errors import ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.rccl_bridge.request_port import tell_key
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.checks.hold_to_run import PATIENCE_NS, hear_key, key_is_held
from qrobot.servo.memory.setpoint_queue import TORQUE_SETPOINT
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.puma import ROBOT
from tests.support.servo_bench import ServoBench, cruise, moving, play, swing

STREAM = 1
BOUND_NS = 100_000_000  # row 51 of the table of faults


def held(bench: ServoBench, stream: int = STREAM) -> list[bool]:
    """A key that says every 28 ms that it is held while the list's entry is true."""
    key, said = [True], [0]

    def say(now_ns: int) -> None:
        if now_ns - said[0] >= 28_000_000:
            tell_key(bench.mailbox, stream, now_ns if key[0] else None)
            said[0] = now_ns

    bench.before.append(say)
    return key


def test_an_arm_moves_while_its_key_is_held() -> None:
    bench = ServoBench()
    held(bench)
    moving(bench, seconds=1.5)
    assert bench.mode is Mode.TRACKING


@pytest.mark.parametrize("link_lost", [False, True])
def test_a_key_let_go_or_a_link_lost_stops_the_arm_on_its_path_within_100_ms(link_lost: bool) -> None:
    bench = ServoBench()
    key = held(bench)
    moving(bench)
    released_ns = bench.now_ns
    key[0] = False
    if link_lost:
        bench.before.clear()
    bench.until(lambda: bench.mode is Mode.STOPPING)
    assert bench.now_ns - released_ns <= BOUND_NS
    if not link_lost:  # then the setpoints stay away as well, and one of both is told
        assert bench.event is FaultCode.HOLD_TO_RUN
    bench.until(lambda: bench.mode is Mode.HOLDING)
    assert bench.powered
    bench.run(0.5)
    assert bench.mode is Mode.HOLDING


@pytest.mark.parametrize(
    ("joint", "speed"), [(0, -0.5), (1, 0.02), (2, -0.02), (3, 0.5), (4, -0.5), (5, 0.02), (5, -0.02)]
)
def test_a_key_let_go_stops_any_joint_either_way(joint: int, speed: float) -> None:
    bench = ServoBench(pose="ready")
    key = held(bench)
    moving(bench, speed, joint, seconds=0.5)
    released_ns, key[0] = bench.now_ns, False
    bench.until(lambda: bench.mode is Mode.STOPPING, 0.2)
    assert bench.event is FaultCode.HOLD_TO_RUN
    assert bench.now_ns - released_ns <= BOUND_NS


def test_a_program_that_goes_on_while_its_key_hangs_is_stopped() -> None:
    bench = ServoBench()
    tell_key(bench.mailbox, STREAM, bench.now_ns)
    bench.hold()
    play(bench, cruise(bench.q, np.array([0.5, 0, 0, 0, 0, 0])))
    bench.until(lambda: bench.mode is Mode.STOPPING)
    assert bench.event is FaultCode.HOLD_TO_RUN


def test_without_its_key_the_arm_may_stand_but_not_begin_to_move() -> None:
    bench = ServoBench().hold()
    start = bench.q.copy()
    tell_key(bench.mailbox, STREAM, None)
    play(bench, lambda t: start if t < 1.0 else swing(start, np.full(6, 0.1), 1.0)(t - 1.0))
    bench.run(0.9)
    assert bench.mode is Mode.TRACKING
    bench.until(lambda: bench.mode is Mode.HOLDING)
    assert bench.event is FaultCode.HOLD_TO_RUN
    assert np.abs(bench.q - start).max() < 1e-3


def test_a_torque_needs_the_key_as_well() -> None:
    bench = ServoBench().hold()
    tell_key(bench.mailbox, STREAM, None)

    def push(seq: int, modes: list[int], values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> None:
        if seq > 20:
            modes[5], values[5] = TORQUE_SETPOINT, 0.5

    start = bench.q.copy()
    play(bench, lambda _t: start.copy(), edit=push)
    bench.until(lambda: bench.event is FaultCode.HOLD_TO_RUN)


def test_another_stream_needs_no_key() -> None:
    bench = ServoBench()
    tell_key(bench.mailbox, STREAM + 1, None)
    moving(bench, seconds=1.5)
    assert bench.mode is Mode.TRACKING


@given(
    stream=st.integers(0, 1 << 40),
    other=st.integers(0, 1 << 40),
    held_ns=st.integers(0, 1 << 60),
    now_ns=st.integers(0, 1 << 60),
)
def test_only_a_fresh_word_for_this_stream_lets_it_move(stream: int, other: int, held_ns: int, now_ns: int) -> None:
    fresh = 0 <= now_ns - held_ns <= PATIENCE_NS
    assert key_is_held(stream + 1, stream, held_ns, now_ns) == fresh
    assert key_is_held(0, stream, held_ns, now_ns)
    assert key_is_held(other + 1, stream, held_ns, now_ns) == (fresh or other != stream)


@pytest.mark.parametrize("age_ns", [-1, 0, 1, PATIENCE_NS - 1, PATIENCE_NS, PATIENCE_NS + 1])
def test_the_patience_ends_at_its_nanosecond(age_ns: int) -> None:
    assert key_is_held(1, 0, 1_000, 1_000 + age_ns) == (0 <= age_ns <= PATIENCE_NS)


MS = 1_000_000
NOW_NS = 5_000 * MS


def hears(told_ms: list[float], slips: int = 0) -> list[bool]:
    """Whether the key counts as held, at each cycle of 2 ms that began 2 ms late, by when it was said to be."""
    params, answers = SimpleNamespace(board_slips=slips), []
    state = SimpleNamespace(began_ns=0, key_told_ns=0, key_ns=0)
    hear = getattr(hear_key, "py_func", hear_key)
    held = getattr(key_is_held, "py_func", key_is_held)
    for cycle, ms in enumerate(told_ms):
        state.began_ns = NOW_NS + 2 * cycle * MS + 2 * MS
        hear(params, state, NOW_NS + round(ms * MS))
        answers.append(held(1, 0, state.key_ns, state.began_ns))
    return answers


def test_a_key_that_was_said_to_be_held_after_the_deadline_of_a_late_cycle_is_held() -> None:
    assert hears([1.0])  # the cycle was due at 0, and began at 2
    assert hears([11.9] + [11.9] * 35) == [True] * 36  # it came while the cycle ran, and counts from its beginning
    assert hears([12.0] * 36) == [True] * 36
    assert hears([12.0] * 37)[-1] is False  # 70 ms after the cycle that saw it first


def test_a_key_from_the_future_is_not_held_but_where_time_was_put_back() -> None:
    assert hears([12.1, 1000.0, 1e9]) == [False, False, False]
    assert hears([1e9], slips=1) == [False]
    assert hears([1011.0] * 37, slips=1) == [True] * 36 + [False]


def test_a_cycle_that_comes_late_stops_no_arm_whose_key_is_held() -> None:
    bench = ServoBench()
    said = [0]

    def say(now_ns: int) -> None:
        if now_ns - said[0] >= 28 * MS:
            said[0] = now_ns
            tell_key(bench.mailbox, STREAM, now_ns + MS)  # while the cycle waits for its processor

    bench.before.append(say)
    moving(bench, seconds=1.5)
    assert bench.mode is Mode.TRACKING


def test_a_program_jogs_as_long_as_its_key_is_held_and_is_told_why_it_ended() -> None:
    rig = LockstepRig(ROBOT, ServoSettings(rate_hz=500.0), Emulator(ROBOT, physics="rigid"))
    released_ns = 0

    def jog(arm: rccl.Channel) -> None:
        nonlocal released_ns
        arm.chg.hold_to_run = True
        arm.each_sample(lambda: setattr(arm.chg, "key_held", True))
        arm.move(arm.pose("ready"))
        arm.waitas(lambda: arm.time > 500.0)
        released_ns = rig.now_ns
        arm.each_sample(None)  # what was said is lowered with each command
        arm.waitfor(arm.completed)

    with (
        rccl.use(partial(link_factory, rig, 28_000)),
        pytest.raises(ServoFault, match="HOLD_TO_RUN"),
        rccl.control() as arm,
    ):
        jog(arm)
    rig.run_for(0.5)
    rows = rig.rows()
    stopping = rows[rows["mode"] == Mode.STOPPING]
    assert 0 < stopping["t_ns"][0] - released_ns <= BOUND_NS
    assert Mode(int(rows["mode"][-1])) is Mode.HOLDING
