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
from qrobot.rci.machine_choice import MachineChoice, use_machine
from tests.support.arcl import EXAMPLES, forget_programs
from tests.support.patience import wait_until
from tests.support.processes import RunningArm
from tests.support.puma import ROBOT

pytestmark = pytest.mark.realtime


def test_the_papers_program_moves_a_running_arm_s11(
    arm: RunningArm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    forget_programs()
    monkeypatch.setenv("QROBOT_BRIDGE", f"{arm.arm.bridge.host}:{arm.arm.bridge.port}")
    words = ["run", "--deployment", str(arm.deployment), "--output", str(tmp_path)]
    assert run_app(make_app("run"), [*words, str(EXAMPLES / "s11_first_program.py")]) == 0
    assert "EVENT_LIMIT: move to pos: configuration 'lun'" in capsys.readouterr().out
    assert not arm.snapshot().fault
    stream = read_stream(tmp_path / "puma560.arcl")
    assert (stream.start.machine, stream.damage) == ("bridge", "")
    (_, asked), (_, measured) = (stream.table(kind, 6) for kind in (RecordKind.JOINTS, RecordKind.MEASURED))
    assert np.ptp(asked, axis=0).max() > 1.0  # it did move
    assert np.abs(measured[-1] - asked[-1]).max() < 0.01


def test_a_running_arm_is_lent_to_the_pendant_and_taken_again(arm: RunningArm, monkeypatch: pytest.MonkeyPatch) -> None:
    forget_programs()
    monkeypatch.setenv("QROBOT_BRIDGE", f"{arm.arm.bridge.host}:{arm.arm.bridge.port}")
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
    assert not arm.snapshot().fault
