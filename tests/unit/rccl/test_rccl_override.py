"""Override, pause and resume of RCCL programs: the program's own and the operator's, before a robot that follows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from qrobot import rccl
from qrobot.errors import MotionError
from qrobot.rccl.setpoints import Setpoints
from qrobot.rccl.transforms import made_transform
from qrobot.rci import VirtualLink
from tests.support.fake_robot import FakeRobot
from tests.support.puma import PARK

AWAY = np.array([60.0, 0.0, 0.0, 0.0, 0.0, 0.0])


@pytest.fixture
def fake() -> Iterator[FakeRobot]:
    robot = FakeRobot(tuple(PARK))
    with rccl.use(lambda hello: VirtualLink(hello, robot.transfer)):
        rccl.control()
        yield robot
        rccl.resume()
        rccl.override(100)
        robot.override, robot.paused = 1.0, False
        rccl.release()


def go(fake: FakeRobot, home: bool = False) -> np.ndarray:
    """Turn the waist, and back with `home`; its setpoints from the first that moves to the last. Shape (samples,)."""
    begin = len(fake.path)
    rccl.move(rccl.jposition("AWAY", (np.degrees(PARK) + (0.0 if home else 1.0) * AWAY).tolist()))
    rccl.waitfor(rccl.program.arm().completed)
    rccl.waitas(lambda period=fake.seq: fake.seq > period + 3)  # the last setpoints are followed
    path = np.array(fake.path[begin:])[:, 0]
    moving = np.flatnonzero(np.diff(path))
    return path[moving[0] : moving[-1] + 2]


def test_program_and_operator_slow_a_motion_down_together(fake: FakeRobot) -> None:
    nominal = go(fake)
    rccl.override(50)
    half = go(fake, home=True)
    fake.override = 0.5
    quarter = go(fake)
    assert len(half) == pytest.approx(2 * len(nominal), abs=3)
    assert len(quarter) == pytest.approx(4 * len(nominal), abs=6)
    assert quarter[-1] == pytest.approx(nominal[-1], abs=1e-12)
    fastest = [np.abs(np.diff(path)).max() for path in (nominal, half, quarter)]
    assert fastest == pytest.approx(fastest[0] * np.array([1.0, 0.5, 0.25]), rel=0.02)


def test_more_than_the_programmed_speed_is_the_programmed_speed(fake: FakeRobot) -> None:
    nominal = go(fake)
    for strange in (2.0, float("nan")):
        fake.override = strange
        go(fake, home=True)
        assert go(fake) == pytest.approx(nominal, abs=1e-12)


@pytest.mark.parametrize("who", ["program", "operator"])
def test_a_pause_holds_the_arm_on_its_path_until_it_is_resumed(fake: FakeRobot, who: str) -> None:
    nominal = go(fake)
    go(fake, home=True)
    seen: dict[str, float] = {}

    def interfere(period: int) -> None:
        since = period - interfere.begin
        if since == 12:
            (rccl.pause if who == "program" else lambda: setattr(fake, "paused", True))()
        if since == 60:
            seen["held"] = fake.q[0]
        if since == 200:
            assert fake.q[0] == seen["held"]
            assert rccl.program.arm().completed.count == 0
            (rccl.resume if who == "program" else lambda: setattr(fake, "paused", False))()

    interfere.begin = fake.seq
    fake.before_period = interfere
    paused = go(fake)
    fake.before_period = None
    assert nominal[0] < seen["held"] < nominal[-1]
    assert len(paused) > len(nominal) + 100
    assert paused[-1] == pytest.approx(nominal[-1], abs=1e-12)
    accelerations = np.abs(np.diff(paused, n=2)) / 0.028**2
    assert accelerations.max() <= 12.0  # of the waist, by its robot file


def test_a_program_that_pauses_itself_is_told_of_its_rate(fake: FakeRobot) -> None:
    rccl.move(rccl.jposition("AWAY", (np.degrees(PARK) + AWAY).tolist()))
    assert rccl.program.arm().rate == 1.0
    rccl.pause()
    rccl.waitas(lambda: rccl.program.arm().rate == 0.0)
    rccl.resume()
    rccl.waitas(lambda: rccl.program.arm().rate == 1.0)


@pytest.mark.parametrize("percent", [-1, 101, float("nan"), float("inf"), "fast", None])
def test_an_override_that_is_none_is_refused_and_changes_nothing(fake: FakeRobot, percent: object) -> None:
    nominal = go(fake)
    with pytest.raises(MotionError, match="override"):
        rccl.override(percent)
    go(fake, home=True)
    assert len(go(fake)) == len(nominal)


def play(fake: FakeRobot) -> np.ndarray:
    """Play setpoints of the waist, out and back; those that were sent while it moved. Shape (samples,)."""
    begin = len(fake.path)
    rccl.program.arm().play(out_and_back(fake))
    rccl.waitfor(rccl.program.arm().completed)
    rccl.waitas(lambda period=fake.seq: fake.seq > period + 3)
    path = np.array(fake.path[begin:])[:, 0]
    moving = np.flatnonzero(np.diff(path))
    return path[moving[0] : moving[-1] + 2]


def out_and_back(fake: FakeRobot) -> Setpoints:
    q = np.tile(PARK, (101, 1))
    q[:, 0] += 0.25 * (1.0 - np.cos(2.0 * np.pi * np.linspace(0.0, 1.0, 101)))
    return Setpoints("puma560", fake.period_us, q)


def test_setpoints_that_are_played_go_slower_and_stand_as_motions_do(fake: FakeRobot) -> None:
    nominal = play(fake)
    assert len(nominal) == 101
    rccl.override(50)
    half = play(fake)
    assert len(half) == pytest.approx(200, abs=3)
    assert half.max() == pytest.approx(nominal.max(), abs=1e-3)
    rccl.override(100)
    held: list[float] = []

    def interfere(period: int) -> None:
        since = period - interfere.begin
        if since == 20:
            fake.paused = True
        if since in (80, 180):
            held.append(fake.q[0])
            assert rccl.program.arm().rate == 0.0
        if since == 200:
            fake.paused = False

    interfere.begin = fake.seq
    fake.before_period = interfere
    paused = play(fake)
    fake.before_period = None
    assert held[0] == held[1] > PARK[0]
    assert len(paused) > len(nominal) + 150
    assert paused[-1] == pytest.approx(nominal[-1], abs=1e-12)
    assert np.abs(np.diff(paused, n=2)).max() / 0.028**2 <= 12.0  # of the waist, by its robot file


def test_setpoints_are_played_behind_a_straight_line_too(fake: FakeRobot) -> None:
    """Its last setpoints still tell of a velocity when it has ended."""
    arm = rccl.program.arm()
    rccl.setmode("cartesian")
    below = arm.measured_t6.copy()
    below[2, 3] -= 0.04
    goal = made_transform("BELOW", rccl.const, below)
    rccl.move(rccl.makeposition("below", rccl.t6, rccl.EQ, goal, rccl.TL, goal))
    rccl.waitfor(arm.completed)
    q = np.tile(fake.q, (11, 1))
    arm.play(Setpoints("puma560", fake.period_us, q))
    rccl.waitfor(arm.completed)
    rccl.setmode("joint")


@pytest.mark.parametrize("what", ["a motion", "setpoints"])
def test_setpoints_are_not_played_while_the_arm_moves(fake: FakeRobot, what: str) -> None:
    arm = rccl.program.arm()
    if what == "a motion":
        rccl.move(rccl.jposition("AWAY", (np.degrees(PARK) + AWAY).tolist()))
    else:
        arm.play(out_and_back(fake))
    rccl.waitas(lambda period=fake.seq: fake.seq > period + 5)
    with pytest.raises(MotionError, match="still moves"):
        arm.play(out_and_back(fake))
