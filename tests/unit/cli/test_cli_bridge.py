"""`qrobot bridge`: what it does beside its service, with a server that only pretends."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from qrobot.cli.bridge import PRIORITY
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from tests.support.patience import wait_until
from tests.support.processes import write_deployment


def test_lines_are_written_at_the_priority_of_the_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever writes a line holds the lock of the interpreter: the thread of the frames would wait with it."""
    asked: set[tuple[str, int]] = set()
    wanted = {(threading.current_thread().name, PRIORITY), ("report", PRIORITY)}
    said: list[str] = []

    def pretend(_port: object, _settings: object, on_ready: Callable[[str, int], None], *_: Any) -> None:
        on_ready("127.0.0.1", 5)
        wait_until(lambda: asked == wanted, "both threads at their priority")
        wait_until(lambda: said, "the line")

    setup = "qrobot.realtime.setup"
    monkeypatch.setattr(f"{setup}.set_fifo", lambda number: asked.add((threading.current_thread().name, number)))
    for name in (f"{setup}.leave_fifo", f"{setup}.freeze_garbage", "qrobot.rccl_bridge.mailbox_port.warm_up"):
        monkeypatch.setattr(name, lambda: None)
    monkeypatch.setattr("qrobot.cli.bridge.note", said.append)
    monkeypatch.setattr("qrobot.rccl_bridge.server.run_bridge", pretend)
    assert run_app(make_app("bridge"), ["bridge", str(write_deployment(tmp_path))]) == 0
    assert "listens on 127.0.0.1:5" in said[0]
