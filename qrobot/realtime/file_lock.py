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


def is_locked_alone(file: IO[Any] | int) -> bool:
    """Whether another one has a file locked; False where its file system knows no locks. The file has no lock then."""
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)  # an exclusive one needs a file that may be written, on NFS
    except BlockingIOError:
        return True
    except OSError:
        return False
    fcntl.flock(file, fcntl.LOCK_UN)
    return False
