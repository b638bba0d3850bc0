"""The monitor of VAL II while the arm is disturbed, in lock-step; `tests.campaigns` has more storms."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.val.interpreter import Interpreter
from qrobot.val.monitor import ValMonitor
from tests.support.puma import ROBOT
from tests.support.val_storms import arm_in_lockstep, storm

COMMANDS = 8
STOPPED_AT, CTRL_C_AT = 25, 8  # samples of the step, and of the way back
PUSH_MICRO = 60_000_000  # N m, on the shoulder


@pytest.mark.sampled(1)
@pytest.mark.parametrize("library", ["rccl", "arcl"])
@pytest.mark.parametrize("seed", range(2))
def test_a_storm_of_commands_and_disturbances_leaves_a_program_that_runs_or_a_reason(library: str, seed: int) -> None:
    found = storm(seed, library, COMMANDS)
    assert found.wrong == [], "\n".join(found.told)


@pytest.mark.parametrize("library", ["rccl", "arcl"])
def test_a_step_that_is_stopped_goes_on_with_proceed_and_ctrl_c_on_the_way_back_keeps_the_path(library: str) -> None:
    rig = LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0), Emulator(ROBOT, physics="rigid"), keep_telemetry=False)
    with arm_in_lockstep(rig, library) as arm:
        monitor = ValMonitor(Interpreter(arm, lambda _: None, lambda _: ""))
        sample, passed, happens = arm.sample, [0], {STOPPED_AT: rig.mailbox.request_power_off}

        def sampled() -> None:
            sample()
            passed[0] += 1
            happens.get(passed[0], lambda: None)()

        arm.sample = sampled  # type: ignore[method-assign]
        monitor.obey("SPEED 100")
        assert "PROCEED leads the arm back" in monitor.obey("DO DRIVE 1, 60, 100")
        assert monitor.obey("STATUS").startswith("paused")
        stopped = arm.q.copy()
        for command in ("ABORT", "DO READY", "EXECUTE nothing"):
            assert "error" in monitor.obey(command)
        for _ in range(60):
            arm.sample()
        assert np.degrees(np.abs(arm.q - stopped)).max() > 0.5  # it coasts and sags until its brakes hold it
        happens[passed[0] + CTRL_C_AT] = _ctrl_c
        assert "interrupted" in monitor.obey("PROCEED")
        assert arm.off_path
        here = arm.q.copy()
        for paused in (False, True, False):  # the operator, whose `qrobot ctl resume` is not PROCEED
            rig.mailbox.request_pause(paused)
            for _ in range(10):
                arm.sample()
        assert np.abs(arm.q - here).max() < 1e-3
        assert "it alone lets it go on; PROCEED leads the arm back" in monitor.obey("DO READY")
        assert monitor.obey("PROCEED") == "completed"
        assert np.degrees(arm.q[0] - ROBOT.poses["park"][0]) == pytest.approx(60.0, abs=0.3)


def _ctrl_c() -> None:
    raise KeyboardInterrupt


@pytest.mark.parametrize("library", ["rccl", "arcl"])
def test_ctrl_c_at_the_sample_in_which_the_arm_comes_to_its_path_leaves_the_rest_to_proceed(library: str) -> None:
    rig = LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0), Emulator(ROBOT, physics="rigid"), keep_telemetry=False)
    with arm_in_lockstep(rig, library) as arm:
        monitor = ValMonitor(Interpreter(arm, lambda _: None, lambda _: ""))
        sample, passed, interrupted = arm.sample, [0], [0]

        def sampled() -> None:
            before = arm.off_path
            sample()
            passed[0] += 1
            if passed[0] == STOPPED_AT:
                rig.mailbox.request_power_off()
            if before and not arm.off_path:
                interrupted[0] += 1
                raise KeyboardInterrupt

        arm.sample = sampled  # type: ignore[method-assign]
        monitor.obey("SPEED 100")
        monitor.obey("DO DRIVE 1, 60, 100")
        for _ in range(60):
            arm.sample()
        assert "interrupted" in monitor.obey("PROCEED")
        assert interrupted == [1]
        here = arm.q.copy()
        for _ in range(10):
            arm.sample()
        assert np.abs(arm.q - here).max() < 1e-3
        assert monitor.obey("PROCEED") == "completed"
        assert np.degrees(arm.q[0] - ROBOT.poses["park"][0]) == pytest.approx(60.0, abs=0.3)
        assert monitor.obey("DO DRIVE 1, -60, 100") == ""


@pytest.mark.parametrize("library", ["rccl", "arcl"])
def test_an_arm_that_was_stopped_at_rest_is_led_back_before_proceed_answers(library: str) -> None:
    rig = LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0), Emulator(ROBOT, physics="rigid"), keep_telemetry=False)
    with arm_in_lockstep(rig, library) as arm:
        monitor = ValMonitor(Interpreter(arm, lambda _: None, lambda _: ""))
        monitor.obey("DO DRIVE 2, 10, 50")
        stood = arm.q.copy()
        rig.mailbox.request_power_off()
        rig.board.panel.push[1] = PUSH_MICRO
        for _ in range(60):
            arm.sample()
        rig.board.panel.push[1] = 0
        assert "error" in monitor.obey("DO READY")
        assert monitor.obey("PROCEED") == "the arm has gone back to its path"
        assert not arm.off_path
        assert np.degrees(np.abs(arm.q - stood)).max() < 0.3
        assert "nothing to go on with" in monitor.obey("PROCEED")
        assert monitor.obey("DO DRIVE 2, -10, 50") == ""
