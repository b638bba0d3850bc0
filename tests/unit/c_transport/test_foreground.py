"""The channel on which a program in C asks, when others have it as well."""

from __future__ import annotations

import socket
import subprocess
import sys
from collections.abc import Iterator

import pytest

from qrobot.c_transport.engine import Foreground, ProgramGone
from qrobot.c_transport.message import CallMessage, Op

WAITS = (sys.executable, "-c", "input()")


@pytest.fixture
def ends() -> Iterator[tuple[Foreground, socket.socket]]:
    """That of the engine; that of the program, which this process has too, as a child of the program would."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    front = Foreground(ours)
    with theirs:
        yield front, theirs
        front.close()


def test_the_end_of_the_process_is_that_of_its_channel_though_a_child_has_it_still(ends) -> None:
    front, theirs = ends
    with subprocess.Popen(WAITS, stdin=subprocess.PIPE) as program:
        front.watch(program.pid)
        theirs.send(CallMessage(Op.REPLY, n=5).encode())
        front.listen()
        assert not front.has_ended()
        assert front.receive().n == 5
        theirs.send(CallMessage(Op.REPLY, n=6).encode())
    with pytest.raises(ProgramGone):
        front.listen()
    assert front.has_ended()
    assert front.receive().n == 6  # its last message
    with pytest.raises(ProgramGone):
        front.receive()


def test_a_number_without_a_process_is_not_watched(ends) -> None:
    front, theirs = ends
    with subprocess.Popen(WAITS, stdin=subprocess.PIPE) as program:
        pass
    front.watch(program.pid)
    front.listen()
    assert not front.has_ended()
    theirs.close()
    with pytest.raises(ProgramGone):
        front.receive()
