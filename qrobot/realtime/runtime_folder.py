"""The runtime folder: where the processes of an arm meet, and where no other account gets in.

Memory, sockets, locks and the token of the bridge are files in it. It is the first of these that there is:

1. `$QROBOT_RUNTIME_DIR`;
2. `/run/qrobot`, made by an administrator, when this account owns it or is in its group `qrobot`;
3. `qrobot` in `$XDG_RUNTIME_DIR`, or else in `/run/user/UID`, when that is this account's and in memory;
4. `/dev/shm/qrobot-UID`.

The folder has mode 0700, or 0750 and the group `qrobot`, and everything in it belongs to the account that owns it. A
folder, file or process of anybody else is refused, never adopted. `qrobot_runtime.h` follows the same rule in C,
and looks at each connection.

A process looks once which one it is, and the `qrobot` command hands it to those that it starts: a log-in or a log-out
meanwhile would lead them elsewhere than to those that they belong to.
"""

from __future__ import annotations

import contextlib
import grp
import os
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

from qrobot.errors import ConfigError, LinkError

VARIABLE: Final = "QROBOT_RUNTIME_DIR"
GROUP: Final = "qrobot"
SHARED_FOLDER: Final = Path("/run/qrobot")
MEMORY_FOLDER: Final = Path("/dev/shm")
USERS_FOLDER: Final = Path("/run/user")
IN_MEMORY: Final = ("tmpfs", "ramfs")
_ROOT: Final = 0
_FOLDER_FLAGS: Final = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC
_FILE_FLAGS: Final = os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NONBLOCK  # a FIFO must not hold us up
_TRIES: Final = 10  # whoever leaves last removes the folder, perhaps between our making and our using it


def runtime_path() -> Path:
    """Path of the folder, whether it exists or not. Raises ConfigError when the variable names no absolute path."""
    if chosen := os.environ.get(VARIABLE):
        if not os.path.isabs(chosen):
            raise ConfigError(f"{VARIABLE} is {chosen!r}; an absolute path is needed, as in {SHARED_FOLDER}")
        return Path(chosen)
    return find_folder(_session_folder(), os.geteuid())


def hand_down_folder() -> None:
    """Let this process, and those that it starts, meet where it would now, whoever logs in or out meanwhile."""
    with contextlib.suppress(ConfigError):  # whoever needs the folder tells it
        os.environ[VARIABLE] = str(runtime_path())


@cache
def find_folder(session: Path, account: int) -> Path:
    """The folder of an account that has chosen none, as it was when this process first asked.

    Args:
        session: the folder of its login session, whether it exists or not.
    """
    if _is_shared_with_us(SHARED_FOLDER):
        return SHARED_FOLDER
    if session.is_absolute() and _is_ours_in_memory(session):
        return session / "qrobot"
    return _memory_folder(account)


def passed_over() -> Path | None:
    """The folder that `$XDG_RUNTIME_DIR` names, where it is none of this account's in memory and so is not taken."""
    session = os.environ.get("XDG_RUNTIME_DIR")
    return Path(session) if session and runtime_path() == _memory_folder(os.geteuid()) else None


def _session_folder() -> Path:
    return Path(os.environ.get("XDG_RUNTIME_DIR") or USERS_FOLDER / str(os.geteuid()))


def _memory_folder(account: int) -> Path:
    return MEMORY_FOLDER / f"qrobot-{account}"


@dataclass(frozen=True)
class RuntimeFolder:
    """The folder, open and found to be as it must.

    Attributes:
        path: for people.
        fd: descriptor, against which everything in it is opened.
        owner: account that owns it, and everything in it.
    """

    path: Path
    fd: int
    owner: int

    def open_file(self, name: str, flags: int, mode: int = 0o600) -> int:
        """Descriptor of a file in it that is no link, belongs to the folder's owner and that nobody else may write.

        Raises FileNotFoundError when it is missing, LinkError when it is not as it must be.
        """
        try:
            fd = os.open(name, flags | _FILE_FLAGS, mode, dir_fd=self.fd)
        except FileNotFoundError:
            raise
        except OSError as error:
            raise LinkError(
                f"{self.path / name} is no file of {self.owner_name}: {error.strerror}; remove it"
            ) from None
        try:
            self._insist_on_file(name, os.fstat(fd))
        except LinkError:
            os.close(fd)
            raise
        return fd

    def address_of(self, name: str) -> str:
        """Address of a Unix socket in it; however long the path is, it is short enough."""
        return f"/proc/self/fd/{self.fd}/{name}"

    @property
    def owner_name(self) -> str:
        """The account that owns it, for people."""
        return "this account" if self.owner == os.geteuid() else f"account {self.owner}"

    def _insist_on_file(self, name: str, found: os.stat_result) -> None:
        plain = stat.S_ISREG(found.st_mode) and found.st_nlink <= 1
        if not plain or found.st_uid != self.owner or found.st_mode & 0o037:
            raise LinkError(
                f"{self.path / name} (account {found.st_uid}, mode {found.st_mode & 0o7777:04o}) is not a plain file "
                f"that only {self.owner_name} may write: it is not used; remove it"
            )


@contextlib.contextmanager
def serve_in_folder() -> Iterator[RuntimeFolder]:
    """The folder, to make files in it: made when it is missing.

    Raises:
        LinkError: it belongs to another account, others may write in it, it is not in memory, or nothing is there to
            make it in.
    """
    path = runtime_path()
    with contextlib.suppress(FileExistsError), _explained(path):
        _make(path)
    with _opened(path) as folder:
        if folder.owner != os.geteuid():
            raise LinkError(f"{path} belongs to account {folder.owner}: serve as that account, or {_ELSEWHERE}")
        yield folder


@contextlib.contextmanager
def look_into_folder() -> Iterator[RuntimeFolder]:
    """The folder, to reach what is served in it.

    Raises:
        FileNotFoundError: there is none.
        LinkError: it belongs to another account that does not share it, or others may write in it.
    """
    with _opened(runtime_path()) as folder:
        yield folder


def open_served(name: str, flags: int) -> int:
    """Descriptor of file `name` in the folder, made with it when missing. Raises LinkError, see `RuntimeFolder`."""
    for _ in range(_TRIES):
        with contextlib.suppress(FileNotFoundError), serve_in_folder() as folder:
            return folder.open_file(name, flags | os.O_CREAT)
    raise LinkError(f"{runtime_path()} is removed again and again: does another program clean up there?")


def tidy_folder(path: Path) -> None:
    """Remove folder `path` when it is empty and one of those that are made when they are missing."""
    if path in (_session_folder() / "qrobot", _memory_folder(os.geteuid())):
        with contextlib.suppress(OSError):
            path.rmdir()


_ELSEWHERE: Final = f"choose another folder with {VARIABLE}"


def _make(path: Path) -> None:
    try:
        os.mkdir(path, 0o700)
    except FileNotFoundError:
        raise LinkError(
            f"the runtime folder {path} cannot be made: there is no {path.parent}; that of a login session goes when "
            f"its account logs out ({_ELSEWHERE})"
        ) from None


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[RuntimeFolder]:
    with _explained(path):
        fd = os.open(path, _FOLDER_FLAGS)
    try:
        found = os.fstat(fd)
        _insist_on_folder(path, found)
        yield RuntimeFolder(path, fd, found.st_uid)
    finally:
        os.close(fd)


@contextlib.contextmanager
def _explained(path: Path) -> Iterator[None]:
    """Errors of the system as ours, but for a folder that is missing or there already."""
    try:
        yield
    except (FileNotFoundError, FileExistsError):
        raise
    except OSError as error:
        raise LinkError(f"the runtime folder {path} cannot be used: {error.strerror}; {_ELSEWHERE}") from None


def _insist_on_folder(path: Path, found: os.stat_result) -> None:
    mode, shared = found.st_mode & 0o7777, _is_of_group(found)
    if found.st_uid != os.geteuid() and not shared and os.geteuid() != _ROOT:
        raise LinkError(f"the runtime folder {path} belongs to account {found.st_uid}: not used; {_ELSEWHERE}")
    if mode & (0o027 if shared else 0o077):
        wanted = f"0750 for the group {GROUP}" if shared else f"0700 (or 0750 with the group {GROUP})"
        raise LinkError(f"the runtime folder {path} has mode {mode:04o}, wanted is {wanted}: chmod it, or {_ELSEWHERE}")
    if not _in_memory(found.st_dev):
        raise LinkError(f"the runtime folder {path} is not in memory (tmpfs): {_ELSEWHERE}")


def _is_shared_with_us(path: Path) -> bool:
    try:
        found = os.lstat(path)
    except OSError:
        return False
    mine = found.st_uid == os.geteuid() or _is_of_group(found)
    return stat.S_ISDIR(found.st_mode) and mine and _in_memory(found.st_dev)


def _is_ours_in_memory(path: Path) -> bool:
    try:
        found = os.lstat(path)
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.geteuid() and _in_memory(found.st_dev)


def _is_of_group(found: os.stat_result) -> bool:
    """True when it is of the group `qrobot`, and so are we, or we own it."""
    if found.st_uid != os.geteuid() and found.st_gid not in (os.getegid(), *os.getgroups()):
        return False
    try:
        return grp.getgrgid(found.st_gid).gr_name == GROUP
    except KeyError:
        return False


@cache
def _in_memory(device: int) -> bool:
    """True when file system number `device` is held in memory: rings on a disk would be written out under the loop."""
    number = f"{os.major(device)}:{os.minor(device)}"
    for line in Path("/proc/self/mountinfo").read_text().splitlines():
        before, _, after = line.partition(" - ")
        if before.split()[2] == number:
            return after.split()[0] in IN_MEMORY
    return False
