"""A path that outlives stops and faults of the real servo, on the emulated arm."""

from __future__ import annotations

import io
from pathlib import Path
from textwrap import dedent

import numpy as np
import pytest

from qrobot import rccl
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
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
            """Wait, and confirm, as `qrobot ctl resume` does, which somebody else's pause holds up for a while."""
            arm.waitas(lambda: arm.kept)
            begin = arm.time
            arm.waitas(lambda: arm.time > begin + 1e3 * seconds)
            rig.mailbox.request_resume()
            stands = arm.joints
            arm.waitas(lambda: arm.time > begin + 1e3 * seconds + 100.0)
            rig.mailbox.request_pause(True)
            arm.waitas(lambda: arm.time > begin + 1e3 * seconds + 900.0)
            assert arm.kept
            assert arm.joints == pytest.approx(stands, abs=0.01)
            assert rig.mailbox.path_waits(rig.mailbox.snapshot().t_ns)  # what `qrobot ctl status` tells
            stopped.append(arm.joints[0])
            rig.mailbox.request_resume()
            arm.waitas(lambda: not arm.kept)
            arm.waitas(lambda: not rig.mailbox.path_waits(rig.mailbox.snapshot().t_ns))

        arm.keep_path()
        end = arm.pose("ready")
        arm.move(end)
        arm.waitas(lambda: arm.time > 600)
        rig.mailbox.request_stop()
        again(0.5)
        arm.waitas(lambda: arm.rate > 0.5)
        rig.mailbox.request_stop()
        arm.waitas(lambda: arm.kept)
        rig.mailbox.request_resume()  # alone, where there is no pause
        arm.waitas(lambda: not arm.kept)
        arm.waitas(lambda: arm.rate > 0.5)
        rig.board.panel.estop = 1
        arm.waitas(lambda: arm.how.mode == Mode.FAULT)
        rig.board.panel.estop = 0
        again(1.0)
        arm.waitfor(arm.completed)
        assert end.code == Termination.COMPLETED
        assert arm.joints == pytest.approx(np.degrees(ROBOT.poses["ready"]), abs=0.5)
    assert len(stopped) == 2


INTO_THE_TABLE = """
    import numpy as np
    from qrobot import rccl

    place = rccl.newtrans("PLACE", "const")
    arm = rccl.control("puma560")
    arm.keep_path()
    for z, mode in ((-0.05, "joint"), (-0.35, "cartesian")):
        place.set(np.array([[1, 0, 0, 0.45], [0, -1, 0, 0.15], [0, 0, -1, z], [0, 0, 0, 1]]))
        arm.setmode(mode)
        arm.setconf("ruf")
        arm.move(rccl.makeposition("END", rccl.t6, rccl.EQ, place, rccl.TL, place))
        if mode == "joint":
            arm.waitfor(arm.completed)
"""
VAL_INTO_THE_TABLE = """.PROGRAM main
MOVE up
MOVES low
.END
.LOCATIONS
up 500 0 0 90 90 0
low 500 0 -340 90 90 0
.END
"""


def test_a_program_that_ends_off_its_path_where_nobody_can_confirm_fails_with_what_has_stopped_the_arm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("qrobot.rci.standstill.HELD_S", 12.0)
    program = tmp_path / "down.py"
    program.write_text(dedent(INTO_THE_TABLE))
    assert run_app(make_app("run"), ["run", "--lockstep", "--deployment", "pressing", str(program)]) == 1
    assert "COLLISION" in (told := " ".join(capsys.readouterr().err.split()))
    assert "12 s of virtual time, where the program alone can let it go on" in told


@pytest.mark.parametrize("library", ["rccl", "arcl"])
def test_the_end_of_what_is_typed_at_the_monitor_gives_the_path_up_of_an_arm_that_was_stopped(
    library: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "down.v2"
    file.write_text(VAL_INTO_THE_TABLE)
    monkeypatch.setattr("sys.stdin", io.StringIO("EXECUTE main\n"))
    words = ["val", "--lockstep", "--deployment", "pressing", "--library", library, "--load", str(file)]
    assert run_app(make_app("val"), words) == 1
    told = capsys.readouterr()
    assert "paused: the servo stopped the arm" in told.out
    assert "COLLISION" in told.err
