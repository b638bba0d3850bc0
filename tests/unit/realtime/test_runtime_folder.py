"""The runtime folder: where it is, whom it lets in, and that nothing of another account is ever adopted."""

from __future__ import annotations

import grp
import os
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from qrobot.cli import main
from qrobot.errors import ConfigError, LinkError
from qrobot.rccl_bridge.lease import Lease
from qrobot.realtime import runtime_folder
from qrobot.realtime.bridge_token import offered_token
from qrobot.realtime.runtime_folder import (
    find_folder,
    hand_down_folder,
    look_into_folder,
    passed_over,
    runtime_path,
    serve_in_folder,
)
from qrobot.realtime.shared_memory import SharedMemory
from qrobot.servo.memory.commander_lock import Authority
from qrobot.servo.operator.client import ServoClient
from qrobot.servo.operator.sockets import ControlSocket, control_name
from tests.support.accounts import OTHER, as_other_account, needs_root
from tests.support.c_programs import needs_compiler

HEADERS = Path(__file__).parents[3] / "qrobot" / "wire" / "c"
ARM = "puma560"

PRINT_PATH = """
#include "qrobot_runtime.h"
int main(void)
{
    char path[QROBOT_PATH_BYTES];
    int fd = qrobot_runtime_open("puma560-board", O_RDWR), why = errno;
    qrobot_runtime_path(path);
    printf("%s %s\\n", path, fd >= 0 ? "opened" : why == ENOENT ? "missing" : "refused");
    return 0;
}
"""


@pytest.fixture(autouse=True)
def _a_process_that_has_not_looked_yet() -> Iterator[None]:
    find_folder.cache_clear()
    yield
    find_folder.cache_clear()


@pytest.fixture
def memory() -> Iterator[Path]:
    """A fresh folder in memory."""
    path = Path(tempfile.mkdtemp(dir="/dev/shm"))
    yield path
    shutil.rmtree(path, ignore_errors=True)


@pytest.fixture
def folder(memory: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """That folder as the runtime folder."""
    monkeypatch.setenv("QROBOT_RUNTIME_DIR", str(memory))
    return memory


@pytest.fixture
def session(memory: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """That folder as the folder of a login session, with nothing that comes before it."""
    monkeypatch.delenv("QROBOT_RUNTIME_DIR", raising=False)
    monkeypatch.setattr(runtime_folder, "SHARED_FOLDER", memory / "none")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(memory))
    return memory


def test_the_variable_comes_first_then_the_shared_folder_then_the_session_then_memory(
    memory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shared, session = memory / "shared", memory / "session"
    shared.mkdir(0o700)
    session.mkdir(0o700)
    monkeypatch.setattr(runtime_folder, "SHARED_FOLDER", shared)
    monkeypatch.setenv("QROBOT_RUNTIME_DIR", str(memory / "chosen"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(session))
    found = [runtime_path()]
    monkeypatch.delenv("QROBOT_RUNTIME_DIR")
    for folder in (shared, session, None):
        find_folder.cache_clear()
        found.append(runtime_path())
        if folder is not None:
            folder.rmdir()
    assert found == [memory / "chosen", shared, session / "qrobot", Path(f"/dev/shm/qrobot-{os.geteuid()}")]


@pytest.mark.parametrize("logged_in", [True, False])
def test_a_process_and_those_that_it_starts_meet_where_they_did_when_an_account_logs_in_or_out(
    session: Path, logged_in: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    login = session / "login"
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(login))
    login.mkdir() if logged_in else None
    before = runtime_path()
    assert (before.parent == login) is logged_in
    login.rmdir() if logged_in else login.mkdir()
    assert runtime_path() == before
    monkeypatch.setenv("QROBOT_RUNTIME_DIR", "")
    hand_down_folder()
    find_folder.cache_clear()  # as in a process that has just been started
    assert runtime_path() == before


def test_the_command_hands_its_folder_to_those_that_it_starts(session: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[str] = []
    monkeypatch.setenv("QROBOT_RUNTIME_DIR", "")
    monkeypatch.setattr(sys, "argv", ["qrobot", "--version"])
    monkeypatch.setattr(main, "tell_compiling", lambda _report: None)
    monkeypatch.setattr(main, "run_app", lambda *_: seen.append(os.environ["QROBOT_RUNTIME_DIR"]))
    with pytest.raises(SystemExit):
        main.main()
    assert seen == [str(session / "qrobot")]


def test_a_folder_that_was_handed_down_goes_with_its_last_file_as_well(
    session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("QROBOT_RUNTIME_DIR", "")
    hand_down_folder()
    SharedMemory.create("a", 1, 64).close(unlink=True)
    assert not (session / "qrobot").exists()


def test_where_the_folder_can_no_longer_be_made_each_is_told_why_and_nobody_tries_for_ever(
    session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("QROBOT_RUNTIME_DIR", str(session / "gone" / "qrobot"))
    for serve in (
        lambda: SharedMemory.create("a", 1, 64),
        lambda: ControlSocket(ARM, lambda _visitor, line: line, lambda _visitor: None),
        lambda: offered_token(5600).__enter__(),
    ):
        with pytest.raises(LinkError, match=r"there is no .*/gone; .* logs out"):
            serve()
    lease = Lease(Authority(ARM))
    assert not lease.take(lease, "a program")
    assert "cannot be commanded" in lease.refusal
    assert not lease.taken


def test_a_session_folder_on_a_disk_is_passed_over_and_a_chosen_one_is_refused(
    session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runtime_folder, "IN_MEMORY", ())  # as if every file system were on a disk
    runtime_folder._in_memory.cache_clear()
    monkeypatch.setattr(runtime_folder, "MEMORY_FOLDER", tmp_path)
    assert runtime_path().parent == tmp_path
    assert passed_over() == session
    monkeypatch.setenv("QROBOT_RUNTIME_DIR", str(session))
    assert passed_over() is None
    with pytest.raises(LinkError, match="not in memory"), serve_in_folder():
        pass
    runtime_folder._in_memory.cache_clear()


def test_a_session_folder_that_is_taken_is_not_passed_over(session: Path) -> None:
    assert runtime_path() == session / "qrobot"
    assert passed_over() is None


def test_a_variable_that_is_no_absolute_path_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("QROBOT_RUNTIME_DIR", "here")
    with pytest.raises(ConfigError, match="an absolute path is needed"):
        runtime_path()


def test_the_folder_is_made_for_us_alone_and_goes_with_the_last_file(session: Path) -> None:
    made = session / "qrobot"
    with SharedMemory.create("a", 1, 64), SharedMemory.create("b", 1, 64):
        assert made.stat().st_mode & 0o7777 == 0o700
        assert {path.stat().st_mode & 0o7777 for path in made.iterdir()} == {0o600}
    assert not made.exists()


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o711, 0o704, 0o1777])
def test_a_folder_that_others_get_into_is_refused_with_what_to_do(folder: Path, mode: int) -> None:
    folder.chmod(mode)
    with pytest.raises(LinkError, match=f"mode {mode:04o}, wanted is 0700.*QROBOT_RUNTIME_DIR"):
        SharedMemory.create("a", 1, 64)
    with pytest.raises(LinkError, match="chmod"):
        ServoClient(ARM)


def test_a_link_in_the_place_of_the_folder_or_of_a_file_is_refused(
    folder: Path, memory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    treasure = memory / "treasure"
    treasure.write_bytes(bytes(512))
    (folder / "a").symlink_to(treasure)
    with pytest.raises(LinkError, match="remove it"):
        SharedMemory.create("a", 1, 64)
    with pytest.raises(LinkError, match="remove it"):
        SharedMemory.attach("a", 1)
    assert treasure.read_bytes() == bytes(512)
    (folder / "link").symlink_to(memory)
    monkeypatch.setenv("QROBOT_RUNTIME_DIR", str(folder / "link"))
    with pytest.raises(LinkError, match="runtime folder"):
        SharedMemory.create("b", 1, 64)


@pytest.mark.parametrize("kind", ["world-writable", "hard link", "FIFO", "folder"])
def test_a_file_that_is_not_plain_and_ours_alone_is_not_adopted(folder: Path, kind: str) -> None:
    place = folder / f"{ARM}-commander"
    match kind:
        case "world-writable":
            place.write_bytes(bytes(512))
            place.chmod(0o666)
        case "hard link":
            (folder / "other").write_bytes(bytes(512))
            place.hardlink_to(folder / "other")
        case "FIFO":
            os.mkfifo(place, 0o600)
        case "folder":
            place.mkdir()
    with pytest.raises(LinkError, match="remove it"):
        Authority(ARM).take("me")
    assert Authority(ARM).maybe_holder() is None


def test_the_socket_of_a_servo_that_was_killed_is_taken_over(folder: Path) -> None:
    name = folder / control_name(ARM)
    left = socket.socket(socket.AF_UNIX)
    left.bind(str(name))
    left.close()
    assert name.exists()
    with ControlSocket(ARM, lambda _visitor, line: line, lambda _visitor: None):
        assert name.stat().st_mode & 0o777 == 0o600
    assert not name.exists()


@needs_root
@pytest.mark.parametrize("mode", [0o700, 0o777])
def test_a_folder_that_another_account_made_beforehand_is_never_used(
    memory: Path, monkeypatch: pytest.MonkeyPatch, mode: int
) -> None:
    memory.chmod(0o1777)
    theirs = memory / "qrobot-0"
    as_other_account(theirs.mkdir)
    as_other_account(lambda: theirs.chmod(mode))
    as_other_account(lambda: (theirs / "puma560-board").write_bytes(bytes(1 << 16)))
    monkeypatch.setenv("QROBOT_RUNTIME_DIR", str(theirs))
    with pytest.raises(LinkError, match=f"account {OTHER}|mode 0777"):
        SharedMemory.create(f"{ARM}-board", 1, 64)
    with pytest.raises(LinkError):
        ControlSocket(ARM, lambda _visitor, line: line, lambda _visitor: None)
    with pytest.raises(LinkError):
        Authority(ARM).take("me")


@needs_root
def test_a_file_of_another_account_is_not_adopted_and_not_overwritten(folder: Path) -> None:
    place = folder / f"{ARM}-board"
    place.write_bytes(b"theirs".ljust(512, b"\0"))
    os.chown(place, OTHER, OTHER)
    with pytest.raises(LinkError, match=f"account {OTHER}"):
        SharedMemory.create(f"{ARM}-board", 1, 64)
    with pytest.raises(LinkError, match=f"account {OTHER}"):
        SharedMemory.attach(f"{ARM}-board", 1)
    assert place.read_bytes().startswith(b"theirs")


@needs_root
def test_another_account_reaches_neither_memory_nor_lock_nor_control_socket(folder: Path) -> None:
    answered: list[bytes] = []

    def answer(_visitor: object, line: bytes) -> bytes:
        answered.append(line)
        return line

    with SharedMemory.create(f"{ARM}-board", 1, 64), ControlSocket(ARM, answer, lambda _visitor: None) as door:
        for attempt in (
            lambda: SharedMemory.attach(f"{ARM}-board", 1),
            lambda: SharedMemory.create(f"{ARM}-board", 1, 64),
            lambda: Authority(ARM).take("them"),
            lambda: ServoClient(ARM),
        ):
            assert "LinkError: the runtime folder" in as_other_account(attempt)
        folder.chmod(0o755)  # as by a slip of its owner
        (folder / control_name(ARM)).chmod(0o666)
        as_other_account(lambda: _say(folder / control_name(ARM), b'{"command": "power off"}\n'))
        for _ in range(3):
            door.serve(0.0)
    assert answered == []


def _say(address: Path, line: bytes) -> None:
    with socket.socket(socket.AF_UNIX) as raw:
        raw.connect(str(address))
        raw.sendall(line)


@needs_root
def test_a_client_does_not_talk_to_a_servo_of_another_account(folder: Path) -> None:
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(str(folder / control_name(ARM)))
    os.seteuid(OTHER)  # whoever listens is known to the kernel by the account of that moment
    try:
        listener.listen()
    finally:
        os.seteuid(0)
    with listener, pytest.raises(LinkError, match=f"is account {OTHER}, not this account"):
        ServoClient(ARM)


@needs_root
def test_the_group_may_look_but_not_serve(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runtime_folder, "GROUP", grp.getgrgid(OTHER).gr_name)
    os.chown(folder, 1, OTHER)
    folder.chmod(0o750)

    def look() -> str:
        with look_into_folder() as found:
            return f"in {found.path}"

    assert as_other_account(look) == f"in {folder}"
    assert "serve as that account" in as_other_account(lambda: SharedMemory.create("a", 1, 64))
    assert "LinkError" in as_other_account(look, group=12345)
    folder.chmod(0o770)
    assert "wanted is 0750" in as_other_account(look)


@pytest.fixture
def says(session: Path, tmp_path: Path) -> Callable[..., list[str]]:
    """What a program in C finds with these variables: the folder, and how it fares with the board's file there."""
    program, source = tmp_path / "where", tmp_path / "where.c"
    source.write_text(PRINT_PATH)
    subprocess.run(["cc", "-std=c99", "-Wall", "-Wextra", "-Werror", f"-I{HEADERS}", source, "-o", program], check=True)

    def run(**variables: str) -> list[str]:
        with pytest.MonkeyPatch.context() as patch:
            for name in ("QROBOT_RUNTIME_DIR", "XDG_RUNTIME_DIR"):
                patch.delenv(name, raising=False)
            for name, value in variables.items():
                patch.setenv(name, value)
            found = subprocess.run([program], env=dict(os.environ), capture_output=True, text=True, check=True)
            assert found.stdout.split()[0] == str(runtime_path())
            return found.stdout.split()

    return run


@pytest.fixture
def board(session: Path) -> Path:
    """The file of a board in the folder of the session."""
    made = session / "qrobot"
    made.mkdir(0o700)
    file = made / f"{ARM}-board"
    file.touch(0o600)
    return file


@needs_compiler
def test_a_c_program_finds_the_same_folder(session: Path, says: Callable[..., list[str]]) -> None:
    assert says(QROBOT_RUNTIME_DIR=str(session / "chosen"))[1] == "missing"
    assert says(XDG_RUNTIME_DIR=str(session))[0] == str(session / "qrobot")
    assert says(XDG_RUNTIME_DIR="/proc")[0] == says()[0]


@needs_compiler
def test_a_c_program_refuses_the_same_files(
    session: Path, tmp_path: Path, board: Path, says: Callable[..., list[str]]
) -> None:
    assert says(XDG_RUNTIME_DIR=str(session))[1] == "opened"
    board.chmod(0o666)
    assert says(XDG_RUNTIME_DIR=str(session))[1] == "refused"
    board.unlink()
    board.symlink_to(tmp_path)
    assert says(XDG_RUNTIME_DIR=str(session))[1] == "refused"
    board.unlink()
    board.touch(0o600)
    board.parent.chmod(0o777)
    assert says(XDG_RUNTIME_DIR=str(session))[1] == "refused"


@needs_root
@needs_compiler
def test_a_c_program_refuses_a_file_that_is_not_of_the_folders_account(
    session: Path, board: Path, says: Callable[..., list[str]]
) -> None:
    os.chown(board, OTHER, OTHER)
    assert says(XDG_RUNTIME_DIR=str(session))[1] == "refused"
    os.chown(board, 0, 0)
    assert says(XDG_RUNTIME_DIR=str(session))[1] == "opened"
