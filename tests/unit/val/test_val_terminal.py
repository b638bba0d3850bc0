"""The terminal of the monitor: what was typed before the arm was stopped lets nothing go on."""

from __future__ import annotations

import os
import pty
import sys
import tty
from collections.abc import Iterator
from select import select
from types import SimpleNamespace

import pytest
from prompt_toolkit.application import create_app_session
from prompt_toolkit.input import create_pipe_input
from prompt_toolkit.output import DummyOutput

from qrobot.val.terminal import forget_typed, serve


class _Monitor:
    """Notes what is to be obeyed; during EX the arm may be stopped."""

    def __init__(self, stops: bool) -> None:
        self.obeyed: list[str] = []
        self.names: list[str] = []
        self.over = self.stopped = False
        self.sure = None
        self._stops = stops

    def obey(self, line: str) -> str:
        self.obeyed.append(line)
        self.over, self.stopped = line == "QUIT", self._stops and line == "EX main"
        return ""


@pytest.mark.parametrize(("stopped", "obeyed"), [(True, ["EX main", "QUIT"]), (False, ["EX main", "PROCEED", "QUIT"])])
def test_what_was_typed_before_the_arm_was_stopped_is_not_obeyed(
    stopped: bool, obeyed: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(isatty=lambda: True, fileno=lambda: -1))
    with create_pipe_input() as typing, create_app_session(input=typing, output=DummyOutput()):
        monitor = _Monitor(stopped)
        typing.send_text("EX main\rPROCEED\rQUIT\r")
        typing.close()
        serve(monitor, lambda _: None)  # type: ignore[arg-type]
    assert monitor.obeyed == obeyed


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[int, int]]:
    """Both ends of a terminal; its near one is the input of this program."""
    far, near = pty.openpty()
    tty.setraw(near)
    with open(near, closefd=False) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield far, near
    os.close(near)
    os.close(far)


def test_what_nobody_has_read_is_forgotten_and_what_is_typed_next_counts(terminal: tuple[int, int]) -> None:
    far, near = terminal
    os.write(far, b"\n")
    assert select([near], [], [], 5.0)[0]
    forget_typed()
    assert not select([near], [], [], 0.0)[0]
    os.write(far, b"x")
    assert os.read(near, 1) == b"x"


def test_lines_of_a_pipe_are_not_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    there, here = os.pipe()
    with open(there) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        os.write(here, b"PROCEED\n")
        os.close(here)
        forget_typed()
        assert stdin.readline() == "PROCEED\n"
