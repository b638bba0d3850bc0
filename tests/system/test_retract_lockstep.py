"""A tool comes down on a table in lock-step: a program that wants that has the arm go back a little afterwards."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from qrobot import rccl
from qrobot.errors import ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.motion import Termination
from qrobot.pendant.held_press import Press
from qrobot.pendant.jog_session import JogSession
from qrobot.rig.lockstep import link_factory
from tests.support.collision_table import BELOW, END, Table, X
from tests.support.puma import LIMITS, ROBOT
from tests.support.puma import arm as puma


def go_down(arm: rccl.Channel, mm_s: float = 150.0) -> rccl.Position:
    """Ask for the way into the table."""
    goal = rccl.newtrans("GOAL", "const")
    goal.set(puma().forward(END))
    end = rccl.makeposition("END", rccl.t6, rccl.EQ, goal, rccl.TL, goal)
    arm.setmode("cartesian")
    arm.setvel(mm_s, 30)
    arm.move(end)
    return end


def run(rig: Table, retract_mm: float) -> None:
    """A program that goes on until it is told of a fault."""
    with rccl.use(lambda hello: link_factory(rig, 28_000, hello)), rccl.control(ROBOT.name) as arm:
        arm.retract(retract_mm)
        go_down(arm)
        arm.waitfor(arm.completed)


def test_after_a_collision_the_arm_goes_back_slowly_by_the_way_it_came_and_the_program_is_told() -> None:
    one = Table()
    with pytest.raises(ServoFault) as told:
        run(one, retract_mm=25)
    assert told.value.code == FaultCode.COLLISION
    one.run_for(0.3)
    assert 0.018 < one.tip_m() < 0.027
    forces, q = np.array(one.forces), np.array(one.setpoints)
    met = int(np.argmax(forces > 1.0))
    after = met + 250  # ms: the servo has stopped the arm, and holds it
    assert forces[met:after].max() > 100.0  # N, the blow itself
    assert forces[after:].max() < 30.0
    assert forces[-1000:].max() == 0.0
    flange = np.array([puma().forward(each)[:3, 3] for each in q[after::28]])
    assert 0.015 < np.linalg.norm(np.diff(flange, axis=0), axis=1).sum() < 0.05  # there, and not back
    assert np.abs(flange[:, :2] - [X, 0.0]).max() < 0.01
    assert (np.abs(np.diff(q[after::28], axis=0)) <= 0.2 * LIMITS.v_max * 0.028).all()


@pytest.mark.parametrize("off", [False, True], ids=["stop", "power off"])
def test_an_arm_that_somebody_stops_after_its_collision_stays_where_it_is(off: bool) -> None:
    one = Table(every=14)
    with rccl.use(lambda hello: link_factory(one, 28_000, hello)), rccl.control(ROBOT.name) as arm:
        arm.retract(25)
        go_down(arm)
        arm.waitas(lambda: one.mailbox.snapshot().event == FaultCode.COLLISION)
        one.mailbox.request_power_off() if off else one.mailbox.request_stop()
        with pytest.raises(ServoFault, match="COLLISION"):
            arm.waitfor(arm.completed)
    there = one.tip_m()
    one.run_for(2.0)
    mode = Mode(int(one.mailbox.snapshot().mode))
    assert mode is (Mode.OFF if off else Mode.HOLDING)
    assert off or abs(one.tip_m() - there) < 0.003
    assert one.tip_m() < 0.01


def test_a_path_that_is_kept_waits_off_what_was_met_and_goes_on_when_that_is_gone() -> None:
    one = Table()
    with rccl.use(lambda hello: link_factory(one, 28_000, hello)), rccl.control(ROBOT.name) as arm:
        arm.keep_path()
        arm.retract(20)
        end = go_down(arm)
        arm.waitas(lambda: arm.kept)
        assert one.tip_m() > 0.01
        one.take_table_away()
        arm.resume()
        arm.waitfor(arm.completed)
        assert end.code == Termination.COMPLETED
    assert one.tip_m() == pytest.approx(-BELOW, abs=0.003)


LOW = (30.0, 40.0, 20.0, 3.0, 3.0, 3.0)  # N m, below the robot file's


@pytest.mark.sampled(3)
@pytest.mark.parametrize("mm_s", [60.0, 250.0])
@pytest.mark.parametrize("reaction", ["stop", "comply", "retract"])
def test_a_program_chooses_what_follows_a_collision_and_how_soon_one_is_told(reaction: str, mm_s: float) -> None:
    one = Table(every=14)
    with rccl.use(lambda hello: link_factory(one, 28_000, hello)), rccl.control(ROBOT.name) as arm:
        arm.collision(reaction, LOW, mm=25)
        assert one.state.watch.asked.tolist() == list(LOW)
        go_down(arm, mm_s)
        with pytest.raises(ServoFault, match="COLLISION"):
            arm.waitfor(arm.completed)
    one.run_for(0.6)
    assert one.state.watch.soft.any() == (reaction == "comply")
    one.run_for(2.0)
    assert not one.state.watch.soft.any()
    assert one.forces[-1] < 30.0
    lowest, highest = (0.018, 0.027) if reaction == "retract" else (-0.001, 0.003)
    assert lowest < one.tip_m() < highest
    assert one.state.watch.asked.tolist() == [0.0] * 6  # the next program has the robot file's again


@pytest.mark.parametrize(("held_on", "back"), [(True, True), (False, False)], ids=["held on", "let go"])
def test_a_jogged_arm_goes_back_from_what_it_met_while_its_button_is_held(
    held_on: bool, back: bool, tmp_path: Path
) -> None:
    """A button that is let go of when it meets something leaves the arm where the servo has stopped it."""
    one, said = Table(), list[str]()

    class Button:
        """Down from half a second on, and told of all the time."""

        def __call__(self) -> float:
            now_s = one.now_ns * 1e-9 - began_s
            if now_s > 0.5 and not self.pressed:
                self.pressed = session.press.begin(Press(1, "axis", "dz", -1.0, share=2.0), now_s)
            met = max(one.forces, default=0.0) > 30.0
            session.press.beat(1, now_s) if held_on or not met else session.press.end()
            return now_s

        pressed = False

    began_s = one.now_ns * 1e-9
    link = lambda hello: link_factory(one, 28_000, hello)  # noqa: E731
    session = JogSession(ROBOT.name, link, tmp_path / "t.db", lambda: None, said.append, Button(), back_mm=25.0)
    with pytest.raises(ServoFault) as told:
        session.run()
    assert told.value.code in (FaultCode.COLLISION, FaultCode.HOLD_TO_RUN)
    one.run_for(0.3)
    assert (one.tip_m() > 0.015) is back
