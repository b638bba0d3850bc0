"""An order to a fork server, as its two sides know it."""

from __future__ import annotations

import struct
from typing import Final, NamedTuple

READY: Final = b"ready"  # what the fork server says once it is prepared
STATUS: Final = struct.Struct("i")  # how a process has ended, as `os.waitstatus_to_exitcode` tells it
MOST_BYTES: Final = 256  # of a message: a process id, or what is wrong; an order stands in a file
MOST_DESCRIPTORS: Final = 32  # of an order; those of an arm's processes are fewer than half of it


class ForkOrder(NamedTuple):
    """A process that is to be forked.

    The file of an order comes with these descriptors behind it: the folder of the process, what it prints to, where its
    status is written, where a byte comes for it to begin, and those of `inherited`.

    Attributes:
        words: of the command line, the program's name first.
        environment: its variables.
        ignored: signals of `signals.ENDING` that it ignores, as a command behind `nohup` does.
        inherited: a variable each, and the number of descriptors that it is to name.
    """

    words: tuple[str, ...]
    environment: dict[str, str]
    ignored: tuple[int, ...]
    inherited: tuple[tuple[str, int], ...]
