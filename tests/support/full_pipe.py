"""A pipe that nobody reads, as the output of a process whose terminal is held."""

from __future__ import annotations

import os
from contextlib import suppress


def fill(pipe: int) -> None:
    """Write until the next byte would wait for somebody to read."""
    os.set_blocking(pipe, False)
    for size in (65_536, 1):
        with suppress(BlockingIOError):
            while True:
                os.write(pipe, bytes(size))
    os.set_blocking(pipe, True)
