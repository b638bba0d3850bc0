"""One process compiles, the others wait and load: the cache on disk shared by processes that start together.

Numba's cache knows no lock. Two processes that meet the same new kernel compile it twice; and because the index is
written before the code, one of them may load what an older version left under the name that the other is about to fill.
Here each kernel has a byte of a lock file beside the cache, held from the look into the cache until the code is there.
Kernels are locked caller before callee, and calls make no circle, so nobody waits for ever; the kernel drops the locks
of a process however it dies. Where there can be no lock (a file system without any), Numba's own behaviour is left.
"""

from __future__ import annotations

import fcntl
import os
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from functools import cache, partial
from pathlib import Path
from typing import Any, Final

from numba.core.compiler_lock import global_compiler_lock

from qrobot.realtime.whole_program import seldom_collected, with_room

LOCK_FILE: Final = "qrobot-compile.lock"


def compile_once(dispatcher: Any) -> None:
    """Let `dispatcher` compile under its lock, where it has a cache."""
    compile_now: Callable[[Any], Any] = dispatcher.compile
    place = _lock_place(dispatcher)
    lock = nullcontext if place is None else partial(lock_of, *place)

    def compile(signature: Any) -> Any:
        # In this order: a thread that waits has no other's lock.
        with global_compiler_lock, lock(), seldom_collected():
            return with_room(compile_now, signature)

    dispatcher.compile = compile


def is_compiled_elsewhere(dispatcher: Any) -> bool:
    """True while another process has the lock of `dispatcher`."""
    place = _lock_place(dispatcher)
    try:
        return place is not None and not _lock_is_free(*place)
    except OSError:
        return False


def _lock_place(dispatcher: Any) -> tuple[Path, str] | None:
    """Folder and name of the lock; None where nothing can be kept."""
    cache = dispatcher._cache
    return (Path(cache.cache_path), cache._cache_file._index_name) if getattr(cache, "may_write", False) else None


def _lock_is_free(folder: Path, name: str) -> bool:
    """Raises OSError where there can be no lock."""
    lock_file, place = _open(folder, os.getpid()), zlib.crc32(name.encode())
    try:
        fcntl.lockf(lock_file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, place)
    except (BlockingIOError, PermissionError):
        return False
    fcntl.lockf(lock_file, fcntl.LOCK_UN, 1, place)
    return True


@contextmanager
def lock_of(folder: Path, name: str) -> Iterator[None]:
    """Hold the lock of the kernel `name` whose cache is in `folder`; without one where there can be none."""
    place = zlib.crc32(name.encode())
    try:
        lock_file = _open(folder, os.getpid())
        fcntl.lockf(lock_file, fcntl.LOCK_EX, 1, place)
    except OSError:
        yield
        return
    try:
        yield
    finally:
        fcntl.lockf(lock_file, fcntl.LOCK_UN, 1, place)


@cache
def _open(folder: Path, _process: int) -> int:
    """The lock file of a folder, open for the life of the process: to close it once would drop all its locks."""
    folder.mkdir(parents=True, exist_ok=True)
    return os.open(folder / LOCK_FILE, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
