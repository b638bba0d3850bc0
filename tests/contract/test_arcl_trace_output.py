"""Traces of a program whose stdout is full, closed or held: its arms move as ever."""

from __future__ import annotations

import errno
import sys
import threading
from collections.abc import Iterator

import numpy as np
import pytest

from qrobot.arcl import (
    ARCL_BRIDGE,
    ARCL_PERIOD,
    MOV_TIME,
    arcl_close,
    arcl_open,
    arcl_wait,
    joint_pos,
    move,
    trace_output,
)
from qrobot.arcl.events import ArclEvent
from qrobot.arcl.switches import switches
from qrobot.report import QueuedReport
from tests.support.arcl import PARK, offline
from tests.support.fake_robot import FakeRobot, TcpRobot
from tests.support.patience import PATIENCE_S, wait_until
from tests.support.puma import PARK as PARK_RAD

AWAY_DEG = 20.0


class Refusing:
    """A stdout that raises."""

    def __init__(self, error: Exception) -> None:
        self.error = error

    def write(self, _: str) -> None:
        raise self.error


class Held:
    """A stdout at which whoever writes waits until it is let go."""

    def __init__(self) -> None:
        self.free = threading.Event()
        self.lines: list[str] = []

    def write(self, line: str) -> None:
        assert self.free.wait(PATIENCE_S)
        self.lines.append(line)

    def flush(self) -> None:
        """All is written already."""


@pytest.fixture(autouse=True)
def traced(arcl_alone: None, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The switch +m, and a thread of the test's own that writes."""
    monkeypatch.setattr(switches, "motions", True)
    trace_output._lines.cache_clear()
    yield
    trace_output._lines.cache_clear()


@pytest.mark.parametrize(
    "stdout",
    [None, Refusing(BrokenPipeError()), Refusing(OSError(errno.ENOSPC, "full")), Refusing(ValueError("closed file"))],
    ids=["none", "nobody reads", "full", "closed"],
)
def test_a_trace_that_cannot_be_written_takes_no_arm(stdout: object, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", stdout)
    rp = offline()
    assert switches.motions
    motion = move(rp, joint_pos(rp, "away", (AWAY_DEG, *PARK[1:])), 0)
    arcl_close(rp)
    assert motion.code == ArclEvent.EVENT_DONE


@pytest.fixture
def robot() -> Iterator[tuple[FakeRobot, str]]:
    fake = FakeRobot(tuple(PARK_RAD), patience=1 << 30)
    with TcpRobot(fake, 0.001) as server:
        yield fake, "{}:{}".format(*server.address)


@pytest.mark.realtime
def test_a_stdout_that_is_held_keeps_no_arm_waiting(
    robot: tuple[FakeRobot, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    fake, place = robot
    stdout = Held()
    monkeypatch.setattr(sys, "stdout", stdout)
    rp = arcl_open(ARCL_BRIDGE, place, ARCL_PERIOD, 4.0, 0)
    goals = [joint_pos(rp, f"P{k}", (AWAY_DEG + k, *PARK[1:])) for k in range(2)]
    motions = [move(rp, goal, MOV_TIME, 400, 0) for goal in goals]
    flushes: list[float] = []
    monkeypatch.setattr(QueuedReport, "flush", lambda _, seconds: flushes.append(seconds))

    def arrived() -> bool:
        """Be asked with the lock of all arms held, as a function in C is before which traces are printed."""
        trace_output.settle()
        trace_output.say("asked")
        return all(motion.code is not None for motion in motions)

    arcl_wait(rp, arrived)
    assert set(flushes) == {trace_output.SAMPLE_PATIENCE_S}
    assert [motion.code for motion in motions] == [ArclEvent.EVENT_DONE] * 2
    assert fake.q[0] == pytest.approx(np.radians(AWAY_DEG + 1))
    assert stdout.lines == []
    stdout.free.set()
    arcl_close(rp)
    wait_until(lambda: len(stdout.lines) >= 4, lambda: f"the lines: {stdout.lines}")
    begins = [line.split(":")[0] for line in stdout.lines]
    assert begins[0] == "request P0"
    assert {"request P1", "exec(stdtg) P0", "exec(stdtg) P1"} < set(begins)
