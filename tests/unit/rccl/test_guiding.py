"""An arm that is led by hand in lock-step: a push at the joints of the emulated arm is the hand."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.errors import ServoFault
from qrobot.hwif.board_memory import PANEL_MICRO
from qrobot.modecodes import Mode
from qrobot.model.arm import Arm
from qrobot.rccl.database import DataBase
from qrobot.rccl.guiding import GuidedArm
from qrobot.rccl.led_by_key import LedByKey
from qrobot.rccl.recordings import smoothed
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.calibration.table import load_table
from qrobot.servo.settings import ServoSettings
from qrobot.servo.stages.guiding import GUIDE_SHARE, GUIDE_SPEED, TOO_FAST, WALL
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.mismatch import PlantMismatch
from qrobot.wire import Payload

ROBOT = load_robot("puma560")
ARM, N = Arm(ROBOT), ROBOT.n
BENT = np.array(ROBOT.poses["ready"]) + np.array([0.3, 0.2, 0.4, 0.3, 0.7, 0.1])
GENTLY = np.array([32.0, 22.0, 12.0, 1.5, 1.5, 1.5])  # N m
PERIOD_US = 28_000


class Guided:
    """An emulated arm, a hand at it, and a key."""

    def __init__(self, q: np.ndarray = BENT, mismatch: PlantMismatch | None = None) -> None:
        emulator = Emulator(ROBOT, start=q, physics="rigid", mismatch=mismatch)
        self.rig = LockstepRig(ROBOT, ServoSettings(calibration=load_table("puma560", ROBOT)), emulator)
        self.rig.run_for(0.3)
        self.arm = GuidedArm(partial(link_factory, self.rig, PERIOD_US), "puma560")
        self.steps(2, held=False)
        self.steps(30)  # power comes on
        assert self.arm.led
        self.rig.take_rows()

    def push(self, tau: np.ndarray) -> Guided:
        self.rig.board.panel.push[:N] = np.round(tau * PANEL_MICRO).astype(np.int64)
        return self

    def steps(self, count: int, held: bool = True) -> Guided:
        for _ in range(count):
            self.arm.step(held)
        return self

    @property
    def mode(self) -> Mode:
        return Mode(self.rig.mailbox.snapshot().mode)

    @property
    def q(self) -> np.ndarray:
        return self.rig.emulator.q.copy()

    def tip_speeds(self) -> np.ndarray:
        """Speed of the flange in each cycle so far, m/s."""
        places = np.array([ARM.flange(q)[:3, 3] for q in self.rig.rows()["q"][::10]])
        return np.linalg.norm(np.diff(places, axis=0), axis=1) / 0.01


@pytest.mark.parametrize("mismatch", [None, PlantMismatch.mismatched(N, seed=3)], ids=["nominal", "mismatched"])
def test_an_arm_stands_without_a_hand_goes_with_one_and_stays_where_the_key_is_let_go(mismatch) -> None:
    one = Guided(mismatch=mismatch)
    before = one.q
    one.steps(30)
    assert np.abs(one.q - before).max() < 1e-4
    one.push(GENTLY).steps(50)
    moved = one.q - before
    assert (moved > -1e-4).all()
    assert (moved[1:] > 0.1).all()
    one.push(0.0 * GENTLY).steps(30, held=False)
    rest = one.q
    assert (one.mode, one.arm.led) == (Mode.HOLDING, False)
    one.push(0.5 * GENTLY).steps(20, held=False)
    assert np.abs(one.q - rest).max() < 0.02  # held as stiffly as ever
    (recording,) = one.arm.recordings
    np.testing.assert_allclose(recording.q[-1], rest, atol=0.02)
    assert not one.rig.rows()["fault"].any()


def test_a_hand_that_hurries_is_braked_and_one_that_tears_at_the_arm_stops_it() -> None:
    one = Guided()
    one.push(1.2 * GENTLY).steps(50)
    assert one.arm.led
    assert GUIDE_SPEED < one.tip_speeds().max() < TOO_FAST * GUIDE_SPEED
    assert (np.abs(one.rig.rows()["v"]) < 1.5 * GUIDE_SHARE * ROBOT.limits.v_max).all()
    with pytest.raises(ServoFault, match="T1_LIMIT"):
        one.push(2.0 * GENTLY).steps(60)
    assert one.tip_speeds().max() < 2.5 * GUIDE_SPEED
    one.push(0.0 * GENTLY).steps(30)
    assert (one.mode, one.arm.led) == (Mode.HOLDING, False)  # the key is still held: that begins nothing
    one.steps(1, held=False).steps(20)
    assert one.arm.led


def test_a_load_that_is_not_there_does_not_let_the_arm_run() -> None:
    one = Guided()
    one.rig.mailbox.request_payload(Payload(2.5, (0.0, 0.0, 0.1)))
    one.steps(60)
    assert one.tip_speeds().max() < 1.3 * GUIDE_SPEED
    one.steps(20, held=False)
    assert one.mode is Mode.HOLDING


def test_a_wall_stands_before_the_end_of_the_range() -> None:
    end = BENT.copy()
    end[1] = ROBOT.limits.q_max[1] - 0.15
    one = Guided(end)
    one.push(np.array([0.0, 40.0, 0.0, 0.0, 0.0, 0.0])).steps(60)
    assert one.arm.led
    into = one.q[1] - (ROBOT.limits.q_max[1] - WALL)
    assert 0.0 < into < 0.5 * WALL
    assert abs(one.arm.step(True).v[1]) < 0.01


@pytest.mark.parametrize("short_of", [0.0, 0.009])
def test_an_arm_that_stands_before_an_end_stays_there_when_the_key_is_pressed_and_leaves_with_a_hand(
    short_of: float,
) -> None:
    end = BENT.copy()
    end[1] = ROBOT.limits.q_max[1] - short_of
    one = Guided(end)
    one.steps(40)
    assert np.abs(one.q - end).max() < 1e-3
    one.push(np.array([0.0, -GENTLY[1], 0.0, 0.0, 0.0, 0.0])).steps(30)
    assert one.arm.led
    assert one.q[1] < end[1] - WALL


def test_without_word_of_the_key_the_arm_stops_within_a_quarter_of_a_second_and_stays() -> None:
    one = Guided()
    one.push(GENTLY).steps(30)
    one.rig.take_rows()
    one.rig.run_for(0.5)  # the program hangs, the hand goes on pushing
    rows = one.rig.rows()
    assert rows["mode"][-1] == Mode.HOLDING
    moving = np.abs(rows["v_ref"]).max(axis=1) > 0.0
    assert np.flatnonzero(moving).max() * 1e-3 < 0.25
    with pytest.raises(ServoFault, match=r"HOLD_TO_RUN|STREAM_LOST"):
        one.steps(5)
    before = one.q
    one.push(0.0 * GENTLY).steps(30)
    assert np.abs(one.q - before).max() < 0.02
    assert not one.arm.led


def test_a_key_of_a_terminal_leads_keeps_places_and_leaves_a_recording_that_can_be_played(tmp_path: Path) -> None:
    one, said = Guided(), []
    one.steps(20, held=False)
    typed = iter([*["g"] * 100, *[""] * 20, "w", *[""] * 40, "w", "?", *[""] * 15, "q"])
    one.push(GENTLY)
    LedByKey(one.arm, lambda: next(typed), said.append, DataBase(tmp_path / "places")).run()
    one.push(0.0 * GENTLY)
    one.arm.close()
    assert [line.split(":")[0].split("\n")[0] for line in said] == [
        "led by hand", "held", "kept P1", "kept P2", "g     HOLD to lead the arm by hand",
    ]  # fmt: skip
    kept = DataBase(tmp_path / "places").values()
    np.testing.assert_allclose(kept["P1"], ARM.forward(one.q), atol=0.02)
    lesson = smoothed(one.arm.recordings[-1], ROBOT, 5e-3)
    assert lesson.q[-1] == pytest.approx(one.q, abs=0.02)
