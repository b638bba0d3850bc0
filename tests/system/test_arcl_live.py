"""An ARCL program in real time, over the bridge of a running arm."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from qrobot.arcl import MOV_TIME, Trans, arcl_close, arcl_open, arcl_wait, joint_pos, move, teach
from qrobot.arcl.stream import RecordKind, read_stream
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.cli.teach_pendant import teach_by_keys
from qrobot.errors import ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.rci.machine_choice import MachineChoice, use_machine
from tests.support.arcl import EXAMPLES, forget_programs
from tests.support.patience import wait_until
from tests.support.processes import RunningArm
from tests.support.puma import ROBOT
from tests.support.shared_arm import SharedArm
from tests.support.stall_watch import ANY_TIME_S, StreamLostError, unless_stalled

pytestmark = pytest.mark.realtime


def test_the_papers_program_moves_a_running_arm_s11(
    shared_arm: SharedArm,
    arm: RunningArm,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("QROBOT_BRIDGE", f"{arm.arm.bridge.host}:{arm.arm.bridge.port}")
    words = ["run", "--deployment", str(arm.deployment), "--output", str(tmp_path)]

    def run_it() -> tuple[int, str]:
        """Its exit status, and what was printed."""
        forget_programs()
        status = run_app(make_app("run"), [*words, str(EXAMPLES / "s11_first_program.py")])
        told = "".join(capsys.readouterr())
        if FaultCode.STREAM_LOST.name in told:  # it runs in this process, which may be kept from running
            raise StreamLostError(told, ANY_TIME_S)
        return status, told

    status, told = unless_stalled(run_it, shared_arm.put_in_order)
    assert status == 0, told
    assert "EVENT_LIMIT: move to pos: configuration 'lun'" in told
    assert not arm.snapshot().fault
    stream = read_stream(tmp_path / "puma560.arcl")
    assert (stream.start.machine, stream.damage) == ("bridge", "")
    (_, asked), (_, measured) = (stream.table(kind, 6) for kind in (RecordKind.JOINTS, RecordKind.MEASURED))
    assert np.ptp(asked, axis=0).max() > 1.0  # it did move
    assert np.abs(measured[-1] - asked[-1]).max() < 0.01


def test_a_running_arm_is_lent_to_the_pendant_and_taken_again(
    shared_arm: SharedArm, arm: RunningArm, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("QROBOT_BRIDGE", f"{arm.arm.bridge.host}:{arm.arm.bridge.port}")

    def lend_it() -> None:
        try:
            lend_and_move(arm)
        except ServoFault as error:
            if FaultCode.STREAM_LOST.name in str(error):
                raise StreamLostError(str(error), ANY_TIME_S) from error
            raise

    unless_stalled(lend_it, shared_arm.put_in_order)
    assert not arm.snapshot().fault


def lend_and_move(arm: RunningArm) -> None:
    """Lend the arm to a pendant that teaches one place, and move a little afterwards."""
    forget_programs()
    taught: list[Trans] = []
    keys = iter("\n")

    def read_keys() -> str:
        return "q" if taught else next(keys, "")

    pendant = partial(teach_by_keys, read_keys=read_keys, tell=lambda _: None)
    with use_machine(MachineChoice("bridge", None, ROBOT, (), pendant)):
        rp = arcl_open(0)
        assert teach(rp, lambda T6, _: taught.append(T6)) == 1
        assert np.allclose(taught[0].value, rp.where().value, atol=1e-3)
        before = arm.snapshot().q
        move(rp, joint_pos(rp, "near", rp.joints + 2.0), MOV_TIME, 400, 0)
        arcl_wait(rp)
        # the last setpoint has been sent, and the servo comes some samples behind it
        wait_until(lambda: np.abs(arm.snapshot().q - before).max() > np.radians(1.9), "the arm has moved")
        arcl_close(rp)
