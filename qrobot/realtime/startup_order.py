"""A process that is started with others gets ready at once and begins when its turn has come.

Importing and compiling take seconds and disturb nobody; what other processes see has an order. A supervisor therefore
starts all its processes together, each with the read end of a pipe of its own, and lets them go on one after the other.
"""

from __future__ import annotations

import os
from typing import Final

from qrobot.errors import LinkLost

TURN_VARIABLE: Final = "QROBOT_TURN"  # file descriptor to read from


def turn_is_awaited() -> bool:
    """True while this process has been started to get ready but not yet to begin."""
    return TURN_VARIABLE in os.environ


def await_turn() -> None:
    """Wait until the supervisor lets this process begin; at once when there is none, or when it did already.

    Call it where signals still have their usual effect. Raises LinkLost when the supervisor has ended.
    """
    descriptor = os.environ.pop(TURN_VARIABLE, "")
    if not descriptor:
        return
    with open(int(descriptor), "rb") as turn:
        if not turn.read(1):
            raise LinkLost("whoever started this process has ended before it could begin")
