"""The end of another process, which its connections may not tell: children that it has forked keep them open."""

from __future__ import annotations

import os


def end_of_process(pid: int) -> tuple[int, ...]:
    """A descriptor that can be read once a process has ended, beside others that are waited for.

    There is none where that cannot be told: its number is of a name space of its own, or the kernel is too old.
    """
    try:
        return (os.pidfd_open(pid),)
    except OSError:
        return ()
