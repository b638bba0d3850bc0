"""The token of a bridge: whoever can read it in the runtime folder may command the arm.

A bridge makes a new one at each start, in a file named after its port, and removes what killed bridges have left. A
client on this machine finds it there; one that comes through a tunnel is given it in `$QROBOT_TOKEN`. What an account
cannot read it cannot send. Behind its random part stands the name of the arm, so that a client that looks for one arm
does not move another at the same address.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from qrobot.errors import LinkBusy, LinkError
from qrobot.realtime.deadline import Deadline, comes_true
from qrobot.realtime.file_lock import lock_alone
from qrobot.realtime.loopback import is_loopback
from qrobot.realtime.runtime_folder import RuntimeFolder, look_into_folder, open_served, serve_in_folder, tidy_folder

VARIABLE: Final = "QROBOT_TOKEN"
RANDOM_BYTES: Final = 32
LONGEST_BYTES: Final = 128
_TOKEN: Final = re.compile(r"bridge-\d+\.token")
_NAMED: Final = re.compile(rb"[0-9a-f]{%d}:([a-z][a-z0-9_]*)" % (2 * RANDOM_BYTES))
LOCKS: Final = Path("/proc/locks")
PATIENCE_S: Final = 3.0  # with another bridge that starts or ends [A]
_PAUSE_S: Final = 0.005  # between two looks at its lock [A]
_SHARED: Final = 0o040  # the folder's group may read


def token_name(port: int) -> str:
    """File name of the token of the bridge at a TCP port of this machine."""
    return f"bridge-{port}.token"


@contextlib.contextmanager
def offered_token(port: int, arm: str = "") -> Iterator[bytes]:
    """A new token, readable in the runtime folder while the block runs; `arm` has the bridge, "" for nobody's.

    The file is locked as long: two bridges that start at once can both take the port until one of them listens, and
    neither the token of the first nor the file is the other's to replace or remove.

    Raises LinkBusy when a living bridge offers its token there, or another process keeps the folder locked; LinkError,
    see `runtime_folder`.
    """
    token = (secrets.token_hex(RANDOM_BYTES) + (f":{arm}" if arm else "")).encode()
    remove_dead_tokens()
    fd = _owned_file(port)
    try:
        os.ftruncate(fd, 0)
        os.write(fd, token)
        _share(fd)
        yield token
    finally:
        _remove(token_name(port), fd)
        fcntl.flock(fd, fcntl.LOCK_UN)  # also when a forked child still has the file open
        os.close(fd)


def token_for(host: str, port: int) -> bytes:
    """The token for the bridge at an address: `$QROBOT_TOKEN`, or its file's, or nothing when there is neither.

    Raises LinkError when the runtime folder or the file is not as it must be.
    """
    if (given := os.environ.get(VARIABLE)) is not None:
        return given.strip().encode()[:LONGEST_BYTES]
    return token_of_file(host, port)


def token_of_file(host: str, port: int) -> bytes:
    """The token that whoever serves an address of this machine has left for its own account; nothing without one.

    Raises LinkError when the runtime folder or the file is not as it must be.
    """
    if host != "localhost" and not is_loopback(host):
        return b""
    try:
        with look_into_folder() as folder:
            fd = folder.open_file(token_name(port), os.O_RDONLY)
    except FileNotFoundError:
        return b""
    with open(fd, "rb") as file:
        return file.read(LONGEST_BYTES)


def arm_of_token(token: bytes) -> str:
    """Name of the arm whose bridge made the token; "" for one that tells none, as that of an isolated link."""
    found = _NAMED.fullmatch(token)
    return "" if found is None else found[1].decode()


def remove_dead_tokens() -> None:
    """Remove the files of bridges that were killed: those that nobody holds locked.

    Where another process keeps the folder locked they stay.
    """
    with contextlib.suppress(OSError, LinkError), look_into_folder() as folder, _alone(folder):
        for name in filter(_TOKEN.fullmatch, os.listdir(folder.fd)):
            with contextlib.suppress(OSError, LinkError):  # it lives, has gone meanwhile, or is none of ours
                _remove_dead(folder, name)
        tidy_folder(folder.path)


def _remove_dead(folder: RuntimeFolder, name: str) -> None:
    fd = folder.open_file(name, os.O_RDONLY)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        _remove(name, fd)
    finally:
        os.close(fd)


def _owned_file(port: int) -> int:
    """Descriptor of the token's file, locked by us and still the one of that name."""
    while True:
        with contextlib.suppress(FileNotFoundError), serve_in_folder() as folder, _alone(folder):
            fd = open_served(token_name(port), os.O_WRONLY)
            try:
                fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if _is_current(token_name(port), fd):
                    return fd
            except BlockingIOError:
                os.close(fd)
                raise LinkBusy(
                    f"another bridge runs at port {port} and offers its token: choose another port"
                ) from None
            os.close(fd)  # the one before us removed it between our opening and our locking


@contextlib.contextmanager
def _alone(folder: RuntimeFolder) -> Iterator[None]:
    """No other bridge looks for dead tokens, or takes one, meanwhile: a moment.

    Whoever may read the folder can lock it, and a process that was stopped keeps its lock. Raises LinkBusy.
    """
    if not comes_true(lambda: lock_alone(folder.fd), Deadline(PATIENCE_S), _PAUSE_S):
        raise LinkBusy(
            f"{_holder(folder.fd)} keeps the runtime folder {folder.path} locked, which bridges do for a moment when "
            "they start and end: has it been stopped, or does it hang? Let it go on, or end it"
        )
    try:
        yield
    finally:
        fcntl.flock(folder.fd, fcntl.LOCK_UN)


def _holder(fd: int) -> str:
    """The process that has a file locked, as words, out of the kernel's table of locks (proc(5))."""
    found = os.fstat(fd)
    place = f"{os.major(found.st_dev):02x}:{os.minor(found.st_dev):02x}:{found.st_ino}"
    with contextlib.suppress(OSError):
        for words in map(str.split, LOCKS.read_text().splitlines()):
            if words[1:2] == ["FLOCK"] and words[5:6] == [place]:
                return f"process {words[4]}"
    return "another process"


def _is_current(name: str, fd: int) -> bool:
    try:
        with look_into_folder() as folder:
            found = os.stat(name, dir_fd=folder.fd, follow_symlinks=False)
    except FileNotFoundError:
        return False
    return os.path.samestat(found, os.fstat(fd))


def _remove(name: str, fd: int) -> None:
    """Remove our file; one that somebody else has put in its place stays."""
    with contextlib.suppress(OSError, LinkError), serve_in_folder() as folder:
        if _is_current(name, fd):
            os.unlink(name, dir_fd=folder.fd)
        tidy_folder(folder.path)


def _share(fd: int) -> None:
    """Let the group of a folder that is shared with one read the token."""
    with serve_in_folder() as folder:
        found = os.fstat(folder.fd)
    if found.st_mode & _SHARED:
        os.fchown(fd, -1, found.st_gid)
        os.fchmod(fd, 0o640)
