"""Fences of a program hold wherever its generator or its task runs: in its own process, or in another one."""

from __future__ import annotations

import socket
from contextlib import suppress

import numpy as np
import pytest

from qrobot import rccl, rci
from qrobot.config.fences import Fence
from qrobot.errors import FenceCrossed
from qrobot.fences.fence_set import FenceSet
from qrobot.fences.in_force import use_fences
from qrobot.motion import Termination
from qrobot.rccl.setpoints import Setpoints
from qrobot.rci import TcpLink
from qrobot.rci.tcp import BRIDGE_VARIABLE, place_text
from tests.support import rci_auxiliary as functions
from tests.support.fake_robot import FakeRobot, TcpRobot
from tests.support.puma import PARK, ROBOT

pytestmark = [pytest.mark.realtime, pytest.mark.parametrize("processor", ["host", "aux"])]
START = tuple(float(x) for x in PARK)
PATIENCE = 1_000_000  # periods without a command
AHEAD_M = 0.06
NEAREST_M = 0.018  # the margin, less what two places of a path leave between them
THROUGH = 0.2  # of joint 1


def wall() -> FenceSet:
    """A plane across y, AHEAD_M beside the flange at park, for the tool alone."""
    _, start, end, radius = FenceSet(ROBOT, []).capsules_at(PARK)[-1]
    place = (0.0, max(start[1], end[1]) + radius + AHEAD_M, 0.0)
    return FenceSet(
        ROBOT, [Fence(name="wall", shape="plane", bodies="tool", position_m=place, rpy_deg=(0.0, 0.0, 90.0))]
    )


class StreamingRobot(TcpRobot):
    """One that tells its state whether the one before was answered or not, as a bridge does."""

    def _talk(self, near: socket.socket) -> None:
        near.setblocking(False)
        with suppress(OSError):
            while not self._over.wait(0.001):
                with suppress(BlockingIOError):
                    if not (data := near.recv(1 << 16)):
                        return
                    near.sendall(self.robot.hear(data))
                near.sendall(self.robot.tell())


def robot() -> FakeRobot:
    return FakeRobot(START, patience=PATIENCE)


def nearest(robot: FakeRobot, fences: FenceSet) -> float:
    """How near the arm has come to the wall, m."""
    return min(float(fences.distances(np.array(q))[0]) for q in robot.path)


def test_no_motion_of_a_generator_leads_through_a_fence(processor: str) -> None:
    fences, there = wall(), np.eye(6)[0] * THROUGH
    share = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, 100)))
    with (
        TcpRobot(robot()) as server,
        rccl.use(lambda hello: TcpLink(hello, server.address)),
        use_fences(fences),
        rccl.control(processor=processor) as arm,
    ):
        with pytest.raises(FenceCrossed, match="fence 'wall'"):
            arm.move(rccl.jposition("through", np.degrees(PARK + there)))
        with pytest.raises(FenceCrossed, match="fence 'wall'"):
            arm.play(Setpoints(ROBOT.name, server.robot.period_us, PARK + share[:, None] * there))
        assert arm.clear_share(np.degrees(PARK), np.degrees(PARK + there)) < 1.0
        goal = rccl.newtrans("GOAL")
        goal.set(arm.measured_t6)
        goal.p.y += 200.0
        arm.move(moving := rccl.makeposition("moving", rccl.t6, rccl.EQ, goal, rccl.TL, goal))
        arm.waitfor(moving.end)
        arm.waitfor(arm.completed)
    assert moving.code == Termination.FENCE
    assert NEAREST_M < nearest(server.robot, fences) < AHEAD_M


def test_no_task_of_rci_leads_its_arm_through_a_fence(processor: str, monkeypatch: pytest.MonkeyPatch) -> None:
    fences = wall()
    monkeypatch.setattr(functions, "START", [])
    with StreamingRobot(robot()) as server, use_fences(fences):
        monkeypatch.setenv(BRIDGE_VARIABLE, place_text(server.address))
        td = rci.rci_create(ROBOT.name, processor)
        rci.rci_control(td, functions.swing)
        try:
            rci.rci_start(td.bit)
            with pytest.raises(FenceCrossed, match=r"task puma560: flange would be .* fence 'wall'"):
                rci.rci_wait(lambda: td.runs > 1000)
        finally:
            rci.rci_close()
    assert NEAREST_M < nearest(server.robot, fences) < AHEAD_M
