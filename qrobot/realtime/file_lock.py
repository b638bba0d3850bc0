"""A lock on an open file, which ends with the file, however its process ends."""

from __future__ import annotations

import fcntl
from typing import IO, Any


def lock_alone(file: IO[Any] | int) -> bool:
    """Lock a file as long as it is open; False when another one has it. True where its file system knows no locks."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # as NFS and FUSE may
        pass
    return True
