"""`qrobot guardian`: what it does beside its watch, with a guardian that only pretends."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from qrobot.cli.console import run_app
from qrobot.cli.guardian import LINES_PRIORITY
from qrobot.cli.main import make_app
from qrobot.realtime.setup import SetupStep
from qrobot.report import Report
from tests.support.patience import wait_until
from tests.support.processes import write_deployment


def test_lines_that_a_full_disk_refuses_end_no_guardian(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[str] = []
    tried: list[str] = []
    asked: list[int] = []

    class Pretence:
        def __init__(self, _arm: str, _timeout_ms: float, report: Report, *_: object, **__: object) -> None:
            self._report = report

        def run(self, _linger_s: float) -> None:
            self._report("the servo is silent")
            done.append("watch")

        def close(self) -> None:
            done.append("close")

    def note(line: str) -> None:
        tried.append(line)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("qrobot.cli.guardian.note", note)
    monkeypatch.setattr("qrobot.realtime.setup.set_fifo", asked.append)
    monkeypatch.setattr("qrobot.cli.guardian.signal.signal", lambda *_: None)
    monkeypatch.setattr("qrobot.servo.process.guardian.Guardian", Pretence)
    monkeypatch.setattr("qrobot.servo.process.guardian.warm_up", lambda: None)
    monkeypatch.setattr(
        "qrobot.servo.process.guardian.prepare", lambda: [SetupStep("memory", False, "the limit is finite", "raise it")]
    )
    assert run_app(make_app("guardian"), ["guardian", str(write_deployment(tmp_path))]) == 0
    assert done == ["watch", "close"]
    wait_until(lambda: len(tried) == 3, "what it was asked for, and both lines")
    assert asked == [LINES_PRIORITY]  # the watch waits for nobody whom an ordinary program keeps from running
