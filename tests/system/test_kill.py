"""Processes die while the arm is on its fast leg; telemetry and the board's stamps tell what the others do.

A program or bridge that dies leaves a stop on the path within two frames and a quarter, a servo that dies loses torque
and power to the guardian, and so on. After each of them the dead process alone is started again, nothing moves by
itself, and the next program works. The tests do not depend on their order.
"""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from qrobot.faultcodes import FaultCode
from qrobot.hwif.board_memory import Lane
from qrobot.hwif.registers import DAC, DAC_ZERO, DISCRETE, DISCRETE_POWER, N_DACS
from qrobot.log.read import read_log
from qrobot.modecodes import Mode
from qrobot.servo.memory.telemetry import Rows
from qrobot.servo.parameters import GUARDIAN_PERIODS
from qrobot.servo.stages.setpoint_stream import SILENCE_MARGIN
from tests.support.patience import PATIENCE_S, STALL_MS, give_time, wait_until
from tests.support.processes import GUARDIAN_MS, UNHURRIED_MS, Killing, RunningArm

pytestmark = pytest.mark.realtime

NS_PER_MS = 1_000_000
TICK_MS = 1.0
PERIOD_MS = UNHURRIED_MS
FAST = 1.0  # rad/s; the legs cruise at 1.05
BRAKED = slice(0, 3)  # the joints with brakes
STILL_COUNTS = 40  # 0.4 degrees at most: joints settle under gravity and friction

BOTH, HELD, NONE = (0b11, 0x28), (0b10, 0x20), (0, 0)  # of the arm's two outputs: as lines, and as bits of DISCRETE

LEGS = """
from numpy import degrees
from qrobot import rccl

arm = rccl.control("puma560", period_ms=100, clear_fault=True)
arm.setjvel(1.05)
poses = arm.robot.poses
left = arm.jposition("left", [-140, *degrees(poses["park"])[1:]])
right = arm.jposition("right", [140, *degrees(poses["end"])[1:]])
arm.move(left)
arm.waitfor(arm.completed)
arm.waitas(lambda: max(map(abs, arm.how.v)) < 0.1)
arm.signal(1, 2)
while True:
    for place in (right, left):
        arm.move(place)
        arm.waitfor(arm.completed)
"""
TIMID = LEGS.replace(", clear_fault=True", "")


@pytest.fixture
def legs(tmp_path: Path) -> Path:
    """A program that goes back and forth for ever."""
    path = tmp_path / "legs.py"
    path.write_text(LEGS)
    return path


@pytest.fixture
def timid(tmp_path: Path) -> Path:
    """The same, but it does not clear faults."""
    path = tmp_path / "timid.py"
    path.write_text(TIMID)
    return path


@contextmanager
def fast_leg(arm: RunningArm, legs: Path) -> Iterator[subprocess.Popen[str]]:
    """Inside, a program is on its first fast leg at constant speed; some four seconds of the leg are left."""
    with arm.moving(legs, FAST, lambda: arm.lamps == BOTH) as program:
        give_time(0.1)  # until it accelerates no more
        yield program


# ------------------------------------------------------------------------------------------------------------- oracles


def ms_between(first_ns: int, then_ns: Any) -> float:
    return float(then_ns - first_ns) / NS_PER_MS


def stop_of(rows: Rows, t_ns: int) -> Rows:
    """The rows of the first stop after a time."""
    stopping = np.flatnonzero((rows["t_ns"] > t_ns) & (rows["mode"] == Mode.STOPPING))
    assert stopping.size, "no stop in the telemetry"
    ends = np.flatnonzero(rows["mode"][stopping[0] :] != Mode.STOPPING)
    return rows[stopping[0] : stopping[0] + ends[0]]


def assert_it_begins_in_time(stop: Rows, killing: Killing) -> None:
    """The last frame arrived before the sender was gone; the stop begins in the tick that finds it too old."""
    began_ns = stop["t_ns"][0]
    assert killing.before_ns < began_ns
    assert ms_between(killing.after_ns, began_ns) <= (2 + SILENCE_MARGIN) * PERIOD_MS + TICK_MS + STALL_MS


def assert_a_stop_on_the_path(stop: Rows) -> None:
    """Slower and slower along the line of the leg, to rest; the arm follows the reference all the way."""
    heading = stop["v_ref"][0] / np.linalg.norm(stop["v_ref"][0])
    travelled = stop["q_ref"] - stop["q_ref"][0]
    aside = travelled - np.outer(travelled @ heading, heading)
    assert np.abs(aside).max() < 2e-3
    speed = stop["v_ref"] @ heading
    assert np.all(np.diff(speed) < 1e-3 * speed[0])
    assert speed[0] > FAST
    assert speed[-1] < 0.01 * speed[0]
    assert np.abs(stop["q_ref"] - stop["q"]).max() < 0.02


def assert_nothing_moves(arm: RunningArm, seconds: float = 0.3) -> None:
    """What is held stands: with power every joint, without it those with brakes; the wrist may have to fall first."""
    held = slice(None) if arm.powered else BRAKED
    before = arm.encoders()
    give_time(seconds)
    assert np.abs(np.subtract(arm.encoders(), before))[held].max() <= STILL_COUNTS
    assert arm.mode not in (Mode.TRACKING, Mode.STOPPING)
    arm.wait_for_rest()


def assert_the_rest_runs(arm: RunningArm, before: dict[str, int], killed: str = "") -> None:
    assert arm.running() == {command: pid for command, pid in before.items() if command != killed}


def assert_safe_by_the_boards_stamps(arm: RunningArm, beat_ns: int) -> None:
    """Power off and zero torque, by the guardian, within its bound of the servo's last heartbeat; nothing after it."""
    wait_until(lambda: not arm.powered, "power goes")
    trace = arm.trace()
    by_guardian = trace[(trace[:, 0] > beat_ns) & (trace[:, 1] == Lane.GUARDIAN)]
    first = by_guardian[: 1 + N_DACS]
    assert (first[0, 2], first[0, 3] & DISCRETE_POWER) == (DISCRETE, 0)
    assert sorted(first[1:, 2]) == [DAC + 2 * channel for channel in range(N_DACS)]
    assert (by_guardian[by_guardian[:, 2] != DISCRETE, 3] == DAC_ZERO).all()
    assert 0.0 < ms_between(beat_ns, first[-1, 0]) <= 1.2 * GUARDIAN_MS + STALL_MS
    after = trace[trace[:, 0] > first[-1, 0]]
    assert (after[:, 1] == Lane.GUARDIAN).all()


def assert_braked(arm: RunningArm) -> None:
    """The brakes have caught what moved, and hold it."""
    arm.wait_for_rest()
    before = arm.encoders()
    give_time(0.2)
    assert np.abs(np.subtract(arm.encoders(), before))[BRAKED].max() <= STILL_COUNTS


def assert_refused(arm: RunningArm, program: Path, reason: str) -> None:
    """The program ends with one line that names the reason, and the arm stays without power."""
    with arm.program(program) as process:
        _, complaint = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1
    assert len(complaint.splitlines()) == 1
    assert reason in complaint
    assert not arm.powered
    assert_nothing_moves(arm)


def assert_the_next_program_works(arm: RunningArm) -> None:
    with arm.swinging(rad_s=0.1) as channel:
        channel.stop()
    arm.wait_for(Mode.HOLDING)


def assert_log_reaches(path: Path, t_ns: int) -> None:
    """The log holds every cycle up to a time."""
    wait_until(lambda: read_log(path).rows["t_ns"][-1] >= t_ns, "the recorder writes down the last cycles")
    log = read_log(path)
    assert np.all(np.diff(log.rows["tick"]) == 1)
    assert log.status.lost == 0
    assert log.header.robot == "puma560"


# --------------------------------------------------------------------------------------------------------------- tests


def test_a_killed_program_leaves_a_stop_on_the_path_within_two_frames(arm: RunningArm, legs: Path) -> None:
    before = arm.running()
    with fast_leg(arm, legs) as program:
        killing = arm.kill_process(program)
        arm.wait_for(Mode.HOLDING)
        assert arm.lamps == HELD
    stop = stop_of(arm.telemetry(), killing.before_ns)
    assert_it_begins_in_time(stop, killing)
    assert_a_stop_on_the_path(stop)
    assert_the_rest_runs(arm, before)
    assert_nothing_moves(arm)
    assert_the_next_program_works(arm)


def test_a_killed_bridge_leaves_a_stop_on_the_path_within_two_frames(arm: RunningArm, legs: Path) -> None:
    before = arm.running()
    with fast_leg(arm, legs) as program:
        killing = arm.kill("bridge")
        arm.wait_for(Mode.HOLDING)
        assert arm.lamps == HELD
        assert_the_rest_runs(arm, before, "bridge")
        assert program.wait(PATIENCE_S) == 1
    stop = stop_of(arm.telemetry(), killing.before_ns)
    assert_it_begins_in_time(stop, killing)
    assert stop["fault"][0] == FaultCode.STREAM_LOST
    assert_a_stop_on_the_path(stop)
    arm.processes.start("bridge")
    assert_nothing_moves(arm)
    assert_the_next_program_works(arm)


def test_a_killed_servo_loses_torque_and_power_within_the_guardians_bound(
    arm: RunningArm, legs: Path, timid: Path
) -> None:
    before = arm.running()
    log = arm.log_of_now()
    with fast_leg(arm, legs) as program:
        arm.kill("servo")
        last_ns = arm.snapshot().t_ns
        assert_safe_by_the_boards_stamps(arm, arm.word("heartbeat", "t_ns"))
        assert_braked(arm)
        assert arm.lamps == HELD
        assert_the_rest_runs(arm, before, "servo")
        assert program.wait(PATIENCE_S) == 1
    assert_log_reaches(log, last_ns)
    arm.processes.start("servo")
    arm.wait_for(Mode.FAULT)  # it finds the board taken
    wait_until(lambda: arm.lamps == NONE, "a servo that starts switches everything off")
    assert_refused(arm, timid, "GUARD_TRIP")
    assert_the_next_program_works(arm)


def test_a_servo_that_was_stopped_finds_the_board_taken_and_writes_nothing_more(arm: RunningArm, legs: Path) -> None:
    with fast_leg(arm, legs) as program:
        arm.signal("servo", signal.SIGSTOP)
        try:
            wait_until(lambda: arm.word("guardian", "takeover"), "the guardian acts")
            assert_safe_by_the_boards_stamps(arm, arm.word("heartbeat", "t_ns"))
            assert arm.lamps == HELD
        finally:
            awake_ns = arm.signal("servo", signal.SIGCONT)
        arm.wait_for(Mode.FAULT)
        assert program.wait(PATIENCE_S) == 1
    assert_nothing_moves(arm)
    trace = arm.trace()
    assert (trace[trace[:, 0] > awake_ns, 1] == Lane.GUARDIAN).all()
    assert arm.snapshot().fault == FaultCode.GUARD_TRIP
    assert_the_next_program_works(arm)


def test_a_killed_guardian_makes_the_servo_stop_drop_power_and_refuse_it(arm: RunningArm, legs: Path) -> None:
    before = arm.running()
    with fast_leg(arm, legs) as program:
        arm.kill("guardian")
        seen_ns = arm.word("guardian", "t_ns")
        arm.wait_for(Mode.FAULT)
        wait_until(lambda: not arm.powered, "power goes")
        assert_the_rest_runs(arm, before, "guardian")
        assert program.wait(PATIENCE_S) == 1
    stop = stop_of(arm.telemetry(), seen_ns)
    assert 0.0 < ms_between(seen_ns, stop["t_ns"][0]) <= GUARDIAN_PERIODS * GUARDIAN_MS + STALL_MS
    assert_a_stop_on_the_path(stop)
    assert arm.snapshot().fault == FaultCode.GUARD_LOST
    assert_refused(arm, legs, "GUARD_LOST")  # it clears, but there still is no guardian
    arm.processes.start("guardian")
    assert_nothing_moves(arm)
    assert_the_next_program_works(arm)


def test_a_servo_without_its_board_faults_and_takes_a_new_board_as_it_is(arm: RunningArm, legs: Path) -> None:
    before = arm.running()
    with fast_leg(arm, legs) as program:
        arm.kill("board")
        arm.wait_for(Mode.FAULT)
        # with this much patience the servo may notice first that the joints seem to stand still
        assert arm.snapshot().fault in (FaultCode.BOARD_GONE, FaultCode.FOLLOWING)
        assert_the_rest_runs(arm, before, "board")
        assert program.wait(PATIENCE_S) == 1
    last = arm.image_count
    arm.processes.start("board")
    wait_until(lambda: arm.image_count != last, "an image of the new board, whose counters begin anew")
    assert_nothing_moves(arm)
    assert arm.mode is Mode.FAULT
    assert not arm.powered
    assert_the_next_program_works(arm)


@pytest.mark.thorough
def test_a_killed_log_disturbs_nothing_and_what_it_wrote_can_be_read(arm: RunningArm, legs: Path) -> None:
    before = arm.running()
    path = arm.log_of_now()
    with fast_leg(arm, legs):
        arm.kill("log")
        give_time(0.2)
        assert arm.mode is Mode.TRACKING
        assert_the_rest_runs(arm, before, "log")
    log = read_log(path)
    assert log.torn
    assert log.rows.size
    assert np.all(np.diff(log.rows["tick"]) == 1)
    arm.processes.rig.start(arm.processes.log("--output", arm.arm.log.directory))
    wait_until(lambda: arm.newest_log() != path, "a new log begins")
