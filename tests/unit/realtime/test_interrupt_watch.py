"""The watch that ends a process whose Python does not hear Ctrl-C."""

from __future__ import annotations

import os
import signal
import socket
import threading

import pytest

from qrobot.realtime.interrupt import INTERRUPTED, _watch


@pytest.mark.parametrize(
    ("numbers", "heard", "ended"),
    [
        ([signal.SIGINT], True, []),
        ([signal.SIGINT], False, [INTERRUPTED]),
        ([signal.SIGTERM], False, []),
        ([signal.SIGTERM, signal.SIGINT], True, []),  # one that stands for the other: heard before the watch has looked
        ([signal.SIGINT, signal.SIGINT], True, []),  # Python hears both as one
    ],
)
def test_only_a_ctrl_c_that_nobody_hears_ends_the_process(
    numbers: list[signal.Signals], heard: bool, ended: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    exits: list[int] = []
    monkeypatch.setattr(os, "_exit", exits.append)
    told, wakes, ours = threading.Event(), *socket.socketpair()
    if heard:
        told.set()
    wakes.send(bytes(numbers))
    wakes.close()
    _watch(ours, told, threading.Event(), 0.0)
    assert exits == ended


def test_a_ctrl_c_at_the_end_of_the_block_ends_no_process_later(monkeypatch: pytest.MonkeyPatch) -> None:
    """It may come when nobody here hears of it any more, but whoever did before."""
    monkeypatch.setattr(os, "_exit", lambda _: pytest.fail("ended"))
    over, wakes, ours = threading.Event(), *socket.socketpair()
    over.set()
    wakes.send(bytes([signal.SIGINT]))
    wakes.close()
    _watch(ours, threading.Event(), over, 0.0)
