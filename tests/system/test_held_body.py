"""Two arms in lock-step that hold one body: what one does, the other feels."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

import numpy as np
import pytest

from qrobot import rci
from qrobot.errors import ConfigError, ServoFault
from qrobot.modecodes import Mode
from qrobot.model.transform import inverse, transform
from qrobot.multi_rccl import wait_as
from qrobot.rccl import newtrans, trsl
from qrobot.rccl.program import ending
from qrobot.rccl.transforms import Transform
from qrobot.rig.lockstep import LockstepRig
from qrobot.rig.lockstep_team import LockstepTeam
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.held_body import HeldBody
from tests.support.two_hands import GRIP, HERE, ROBOT, WORLD, carry, reach

BODY_KG = 2.0
WEIGHT_N = BODY_KG * 9.81
SQUEEZE_MM = 8.0
PLANT_HZ = 1000  # as the servo: four steps a cycle would take longer, and move as little
FRAME = 28  # cycles
SOFT = ServoSettings(
    law="cartesian_impedance",
    law_settings={"stiffness_x": 1000.0, "stiffness_y": 1000.0, "stiffness_z": 1000.0, "stiffness_turn": 30.0},
)


class Cell:
    """Two arms, of which the right one's servo has settings to be chosen, and the body.

    Attributes:
        tensions: between the hands, N, in each servo cycle. squeeze: mm by which the right hand is to press.
    """

    def __init__(self, right: ServoSettings) -> None:
        bases = [inverse(WORLD[name].value) for name in WORLD]
        self.body = HeldBody((ROBOT, ROBOT), bases, HERE.value, BODY_KG, dt=1.0 / PLANT_HZ)
        self.rigs = {
            name: LockstepRig(ROBOT, settings, Emulator(ROBOT, plant=arm, plant_hz=PLANT_HZ))
            for name, settings, arm in zip(WORLD, (ServoSettings(), right), self.body.arms, strict=True)
        }
        self.tensions: list[float] = []
        self.squeeze = 0.0
        self.team = LockstepTeam(tuple(self.rigs.values()), lambda: self.tensions.append(self.body.tension))

    def grip(self) -> dict[str, Transform]:
        """Each hand in the object, the right one pressing as is asked for."""

        def press(t: Transform) -> None:
            trsl(t, 0, -100 + self.squeeze, 0)

        return GRIP | {"right": newtrans("PRESS", press)}

    def hold(self) -> None:
        """Both hands take the body."""
        for hand in range(2):
            self.body.hold(hand)

    @contextmanager
    def program(self) -> Iterator[None]:
        with rci.use({name: partial(self.team.link, rig, 28_000) for name, rig in self.rigs.items()}), ending():
            yield


def pause(samples: int) -> None:
    """Let so many samples pass."""
    left = iter(range(samples))
    wait_as(lambda: next(left, None) is None)


@pytest.mark.thorough
def test_what_two_stiff_arms_press_an_arm_that_gives_way_does_not() -> None:
    def tension(right: ServoSettings) -> float:
        cell = Cell(right)
        with cell.program():
            reach(cell.grip())
            pause(10)
            assert abs(cell.tensions[-1]) == 0.0  # nobody has it yet
            cell.hold()
            pause(10)
            assert cell.body.forces.sum(axis=0) == pytest.approx([0.0, 0.0, -WEIGHT_N], abs=0.3)
            for _ in range(20):
                cell.squeeze += SQUEEZE_MM / 20
                pause(1)
            pause(20)
        return cell.tensions[-1]

    assert tension(ServoSettings()) < -40.0  # N: they press
    assert abs(tension(SOFT)) < 15.0


@pytest.mark.thorough
def test_when_one_arm_loses_its_power_the_other_stops_on_its_path_and_the_body_is_not_torn() -> None:
    cell = Cell(SOFT)
    left, right = cell.rigs.values()
    with cell.program():
        obj, _ = reach()
        cell.hold()
        carry(obj)
        pause(40)
        lost_at = len(cell.tensions)
        left.board.panel.estop = 1
        with pytest.raises(ServoFault, match="ESTOP"):
            pause(200)
    cell.team.ticks(1000)
    rows = right.rows()
    assert left.rows()["mode"][-1] == Mode.FAULT
    assert not rows["fault"].any()
    v_ref = np.abs(rows["v_ref"]).max(axis=1)
    braking, rest = (
        lost_at + 3 * FRAME,
        lost_at + 20 * FRAME,
    )  # a command acts a sample later here, hence three
    assert 0.0 < v_ref[braking] < v_ref[lost_at]
    assert not v_ref[rest:].any()
    lean = np.abs(cell.tensions)
    assert lean.max() == pytest.approx(lean[:lost_at].max(), rel=0.2)  # to stop tears no more than to carry
    assert lean.max() < 40.0


def test_a_body_stands_until_it_is_held_and_where_it_is_let_go() -> None:
    body = HeldBody((ROBOT, ROBOT), [np.eye(4), transform(translation=[2.0, 0.0, 0.0])], HERE.value)
    assert body.pose == pytest.approx(HERE.value)
    body.hold(1)
    body.let_go(1)
    assert body.pose == pytest.approx(HERE.value)
    assert not body.forces.any()


def test_a_body_without_mass_and_arms_of_different_periods_are_refused() -> None:
    with pytest.raises(ConfigError, match="mass"):
        HeldBody((ROBOT, ROBOT), [np.eye(4), np.eye(4)], np.eye(4), 0.0)
    with pytest.raises(ConfigError, match="periods"):
        LockstepTeam(
            [
                LockstepRig(ROBOT, ServoSettings(rate_hz=rate), Emulator(ROBOT, physics="rigid"))
                for rate in (1000.0, 500.0)
            ]
        )
