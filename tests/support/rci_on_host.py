"""Control functions for a processor on another host, which offers this module."""

from __future__ import annotations

import os

from qrobot import rci
from qrobot.rci import TaskDescriptor
from tests.support import rci_auxiliary

HEARD: list[bytes] = []


def introduce(_: TaskDescriptor) -> None:
    """Tell the planning program the process."""
    rci.rci_send(1, b"process %d" % os.getpid())


def answer(_: TaskDescriptor) -> None:
    """Send each message back in capitals with the tick it is, and interrupt the program."""
    while True:
        data, sender = rci.rci_receive()
        if sender is None:
            return
        rci.rci_send(sender.bit, data.upper() + b" %d" % rci.rci_ticks())
        if data == b"interrupt":
            rci.rci_signal()


def reach(_: TaskDescriptor) -> None:
    """Want memory that does not reach here."""
    rci.rci_get_memory("counts")


def hang(td: TaskDescriptor) -> None:
    """Never come back."""
    rci_auxiliary.hang(td)


def swing(td: TaskDescriptor) -> None:
    """Turn joint 1 there and back."""
    rci_auxiliary.swing(td)
