"""Named shared memory: a file of 64-bit words in the runtime folder, with one living owner.

The owner holds a record lock, which the kernel drops however the process dies, so a second owner is refused and a
crashed one is not mistaken for a living one. A new owner reuses the file of a crashed one: peers keep their mapping and
see the generation count rise. A forked child shares its parent's lock: an owner starts others by `spawn` or exec.
Whether an owner lives is asked of the file that a peer has mapped: it may have lost its name while the owner goes on,
when an account logs out and its folder is removed. Who asks takes no lock (fcntl(2), F_OFD_GETLK): a peer that is kept
from running in the midst of it keeps no owner out.
(`multiprocessing.shared_memory` before Python 3.13 unlinks a segment when any attached process exits, hence our own.)
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import mmap
import os
import struct
import sys
from pathlib import Path
from types import TracebackType
from typing import Final, Self, TypeVar

import numpy as np

from qrobot.arrays import Words
from qrobot.errors import ConfigError, LinkBusy, LinkError, LinkMismatch
from qrobot.realtime.deadline import sleep_between_looks
from qrobot.realtime.file_lock import lock_alone
from qrobot.realtime.runtime_folder import look_into_folder, open_served, runtime_path, tidy_folder
from qrobot.realtime.structure import WORD_BYTES, dtype_of, record_in, word

_MEMINFO: Final = Path("/proc/meminfo")
_LOCK_TRIES: Final = 10  # [A] while an owner has the lock, which may just end
_LOCK_PAUSE_S: Final = 0.005

_RECORD: Final = struct.Struct("hhqqi4x")  # struct flock: type, whence, start, length, pid
_COMMANDER, _OWNER = 0, 1  # bytes of the file: each stands for a lock of its own


class SegmentHeader:
    """The first cache line of every segment; what the segment is for begins on the next one."""

    magic: int = word(own_line=True)
    layout: int = word()  # version of what the words mean
    owner_pid: int = word()
    generation: int = word()  # rises with every owner
    digest: int = word()  # of the fields behind, see `structure.digest_of`; 0 when none was given


HEADER: Final = dtype_of(SegmentHeader)
BLOCK_BYTES: Final = 512  # of `st_blocks`, stat(2)
HEADER_WORDS: Final = HEADER.itemsize // WORD_BYTES
MAGIC_VALUE: Final = 0x51524F424F54  # "QROBOT"


def segment_path(name: str) -> Path:
    """File behind segment `name`. Raises ConfigError for a name that is no plain file name."""
    return runtime_path() / checked_name(name)


def checked_name(name: str) -> str:
    """`name`, when it can name a file in the runtime folder. Raises ConfigError."""
    if not name or not all(c.isalnum() or c in "-_." for c in name) or name.startswith("."):
        raise ConfigError(f"{name!r} cannot name shared memory: use letters, digits, '-', '_' and '.'")
    return name


class SharedMemory:
    """A mapped file of int64 words; `words` is the array, `header` its begin, `owner`: we hold the lock."""

    def __init__(self, path: Path, fd: int, n_words: int, owner: bool) -> None:
        self.path = path
        self.owner = owner
        self._fd: int | None = fd
        populate = mmap.MAP_POPULATE if owner else 0  # the owner's loop shall not wait for pages
        self._map = mmap.mmap(fd, n_words * WORD_BYTES, flags=mmap.MAP_SHARED | populate)
        self.words: Words = np.frombuffer(self._map, dtype=np.int64)
        self.header: SegmentHeader = record_in(self.words, HEADER)

    @classmethod
    def create(cls, name: str, layout: int, n_words: int, digest: int = 0, tries: int = _LOCK_TRIES) -> Self:
        """Own segment `name`, made or taken over from a dead owner, zeroed but for the header.

        Args:
            name: instance name, see `segment_path`.
            layout: version of what the words mean; `attach` refuses another one.
            n_words: size in 64-bit words, header included.
            digest: of its fields, see `structure.digest_of`; `attach` refuses another one.
            tries: how often to look, 5 ms apart, whether an owner that there is just ends; 1 waits for nobody.

        Raises:
            LinkBusy: a living process owns it.
            LinkError: there is no room for it in shared memory, or the folder or the file is not ours alone.
        """
        path = segment_path(name)
        fd = _open_owned(path, n_words, tries)
        segment = cls(path, fd, n_words, owner=True)
        header, generation = segment.header, 0
        if header.magic == MAGIC_VALUE:  # a new file is zero already
            if (header.layout, header.digest) != (layout, digest):  # peers of that version keep the old file
                segment.close(unlink=True)
                return cls.create(name, layout, n_words, digest, tries)
            generation = int(header.generation)
            segment.words[HEADER_WORDS:] = 0
        header.layout, header.digest = layout, digest
        header.owner_pid, header.generation = os.getpid(), generation + 1
        header.magic = MAGIC_VALUE
        return segment

    @classmethod
    def attach(cls, name: str, layout: int, start: str = "the process that serves it", digest: int = 0) -> Self:
        """Map an existing segment; `start` tells what to start when there is none.

        Raises LinkError when it is missing, is another account's, or has another layout or other fields; it is a
        LinkMismatch when a living owner has given it these.
        """
        path = segment_path(name)
        try:
            with look_into_folder() as folder:
                fd = folder.open_file(path.name, os.O_RDWR)
        except FileNotFoundError:
            raise LinkError(f"no shared memory {path.name!r}: start {start} (looked in {path.parent})") from None
        n_words = os.fstat(fd).st_size // WORD_BYTES
        if n_words < HEADER_WORDS:
            os.close(fd)
            raise LinkError(f"shared memory {path.name!r} is empty: its owner is just starting or has failed")
        segment = cls(path, fd, n_words, owner=False)
        try:
            segment._insist_on_layout(layout, digest)
        except LinkError:
            segment.close()
            raise
        return segment

    def _insist_on_layout(self, layout: int, digest: int) -> None:
        found = int(self.header.layout)
        if (self.header.magic, found, self.header.digest) == (MAGIC_VALUE, layout, digest):
            return
        other = f"layout {found}, this version expects {layout}"
        if found == layout:
            other = f"layout {layout} with other fields than this version expects"
        if self.header.magic == MAGIC_VALUE and self.owner_alive:
            raise LinkMismatch(f"shared memory {self.path.name!r} has {other}: its owner runs other code; restart both")
        raise LinkError(f"shared memory {self.path.name!r} has {other}")

    def claim(self) -> None:
        """Be the one that commands the owner, as long as this segment is open. Raises LinkBusy when another one is.

        The kernel drops the claim however the process dies; it is this segment's, not the process's, and stands
        beside the owner's: a lock on the first byte, which programs in C take too.
        """
        if self._fd is None:
            raise LinkError(f"shared memory {self.path.name!r} is closed")
        if not _maybe_lock(self._fd, _COMMANDER):
            raise LinkBusy(f"{self.path.name!r} is commanded by another process already")

    @property
    def is_current(self) -> bool:
        """False when the file was removed or replaced since we mapped it, and the owner it had has ended."""
        if self._fd is None:
            return False
        return _same_file(self._fd, self.path) or self.owner_alive

    @property
    def owner_alive(self) -> bool:
        """True while some process (this one included) holds the owner's lock on the file that we have mapped."""
        return self._fd is not None and (self.owner or is_owned(self._fd))

    def close(self, unlink: bool = False) -> None:
        """Let go; with `unlink` the owner also removes the file (an orderly end)."""
        if self._fd is None:
            return
        if unlink and self.owner and _same_file(self._fd, self.path):
            self.path.unlink(missing_ok=True)
            tidy_folder(self.path.parent)
        if self.owner:
            fcntl.flock(self._fd, fcntl.LOCK_UN)
        for lock in (_OWNER, _COMMANDER):  # the mapping, and a forked child, have descriptors that would keep them
            _unlock(self._fd, lock)
        os.close(self._fd)  # the mapping lives as long as somebody holds `words`
        self._fd = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close(unlink=self.owner)


SegmentT = TypeVar("SegmentT", bound=SharedMemory)


def discard_dead(name: str) -> None:
    """Remove segment `name` when its owner was killed; what a living process owns, or is no segment, stays."""
    path = segment_path(name)
    try:
        with look_into_folder() as folder:
            fd = folder.open_file(path.name, os.O_RDWR)
    except (FileNotFoundError, LinkError):
        return
    if own(fd) and _same_file(fd, path):
        path.unlink(missing_ok=True)
        tidy_folder(path.parent)
    os.close(fd)


def own(fd: int, tries: int = 1) -> bool:
    """Take the owner's lock of the file that is open, as long as it is; False when somebody else owns it.

    An owner has `flock` as well, by which alone those of versions until 2026-11 are known.
    """
    while not _maybe_own(fd):
        tries -= 1
        if tries == 0:
            return False
        sleep_between_looks(_LOCK_PAUSE_S)
    return True


def _maybe_own(fd: int) -> bool:
    if not _maybe_lock(fd, _OWNER):
        return False
    if lock_alone(fd):
        return True
    _unlock(fd, _OWNER)
    return False


def is_owned(fd: int) -> bool:
    """True when somebody else has the owner's lock of the file that is open. Nobody is kept from it meanwhile."""
    asked = _RECORD.pack(fcntl.F_WRLCK, os.SEEK_SET, _OWNER, 1, 0)
    kind, *_ = _RECORD.unpack(fcntl.fcntl(fd, fcntl.F_OFD_GETLK, asked))
    return bool(kind != fcntl.F_UNLCK)


def has_owner(path: Path) -> bool:
    """True when somebody has the owner's lock of a file; False where that cannot be known."""
    try:
        with path.open("rb") as file:
            return is_owned(file.fileno())
    except OSError:
        return False


def _maybe_lock(fd: int, which: int) -> bool:
    """Take one of the locks; it is this open file's. False when another has it."""
    try:
        fcntl.fcntl(fd, fcntl.F_OFD_SETLK, _RECORD.pack(fcntl.F_WRLCK, os.SEEK_SET, which, 1, 0))
    except (BlockingIOError, PermissionError):  # EAGAIN or EACCES, fcntl(2)
        return False
    return True


def _unlock(fd: int, which: int) -> None:
    fcntl.fcntl(fd, fcntl.F_OFD_SETLK, _RECORD.pack(fcntl.F_UNLCK, os.SEEK_SET, which, 1, 0))


def _open_owned(path: Path, n_words: int, tries: int) -> int:
    while True:
        fd = open_served(path.name, os.O_RDWR)
        if not own(fd, tries):
            os.close(fd)
            raise LinkBusy(f"{path.name!r} belongs to a running process: stop it first, or use another arm name")
        if not _same_file(fd, path):  # unlinked by its owner between our open and our lock
            os.close(fd)
            continue
        size = os.fstat(fd).st_size
        if size not in (0, n_words * WORD_BYTES):  # another version's: peers of that version keep the old file
            path.unlink()
            os.close(fd)
            continue
        _reserve(fd, path, n_words)
        return fd


def _reserve(fd: int, path: Path, n_words: int) -> None:
    """Claim the pages now: a full file system would otherwise kill the owner with SIGBUS at some later store.

    More than there is room for is not tried: a file system as large as the memory would take all of that first, and
    the kernel would kill other processes for it. Pages that a dead owner has left are there already, and stay where
    there is no room for the others: its peers may still look at them.
    """
    there = os.fstat(fd)
    try:
        if n_words * WORD_BYTES - there.st_blocks * BLOCK_BYTES > _room(fd):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        os.posix_fallocate(fd, 0, n_words * WORD_BYTES)
    except OSError as error:
        if there.st_size == 0:
            os.ftruncate(fd, 0)
        os.close(fd)
        raise LinkError(f"no room in {path.parent} for {path.name!r} ({n_words * WORD_BYTES} bytes): {error}") from None


def _room(fd: int) -> int:
    """Bytes that a file may still take: of its file system, and of the memory."""
    free = os.fstatvfs(fd)
    return min(free.f_bavail * free.f_frsize, available_bytes())


def available_bytes() -> int:
    """Memory that new pages may take without anybody losing theirs, as the kernel estimates it."""
    with contextlib.suppress(OSError):
        for line in _MEMINFO.read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) << 10
    return sys.maxsize


def _same_file(fd: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.stat(path), os.fstat(fd))
    except FileNotFoundError:
        return False
