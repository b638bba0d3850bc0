"""An ARCL program in real time, over the bridge of a running arm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from qrobot.arcl.stream import RecordKind, read_stream
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from tests.support.arcl import EXAMPLES, forget_programs
from tests.support.processes import RunningArm

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
