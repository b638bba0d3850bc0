"""A path that outlives stops and faults of the real servo, on the emulated arm."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot import rccl
from qrobot.motion import Termination
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.wire import Mode
from tests.support.puma import ROBOT


def test_after_a_stop_and_after_a_fault_the_operator_leads_the_arm_back_and_the_motion_ends_at_its_goal() -> None:
    rig = LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0), Emulator(ROBOT, physics="rigid"))
    stopped: list[float] = []

    with rccl.use(lambda hello: link_factory(rig, 28_000, hello)), rccl.control(ROBOT.name) as arm:

        def again(seconds: float) -> None:
            """Wait, see that nothing moves, and confirm, as `qrobot ctl pause` and `resume` do."""
            arm.waitas(lambda: arm.kept)
            begin = arm.time
            arm.waitas(lambda: arm.time > begin + 1e3 * seconds)
            rig.mailbox.request_pause(True)
            stands = arm.joints
            arm.waitas(lambda: arm.time > begin + 1e3 * seconds + 300.0)
            assert arm.joints == pytest.approx(stands, abs=0.01)
            assert rig.mailbox.path_waits(rig.mailbox.snapshot().t_ns)  # what `qrobot ctl status` tells
            stopped.append(arm.joints[0])
            rig.mailbox.request_pause(False)
            arm.waitas(lambda: not arm.kept)
            arm.waitas(lambda: not rig.mailbox.path_waits(rig.mailbox.snapshot().t_ns))

        arm.keep_path()
        end = arm.pose("ready")
        arm.move(end)
        arm.waitas(lambda: arm.time > 600)
        rig.mailbox.request_stop()
        again(0.5)
        arm.waitas(lambda: arm.rate > 0.5)
        rig.board.panel.estop = 1
        arm.waitas(lambda: arm.how.mode == Mode.FAULT)
        rig.board.panel.estop = 0
        again(1.0)
        arm.waitfor(arm.completed)
        assert end.code == Termination.COMPLETED
        assert arm.joints == pytest.approx(np.degrees(ROBOT.poses["ready"]), abs=0.5)
    assert len(stopped) == 2
