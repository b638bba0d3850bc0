"""The token of a bridge: read by its own account, shown by programs in Python and C, and by nobody else."""

from __future__ import annotations

import asyncio
import fcntl
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from shutil import rmtree

import pytest

from qrobot.errors import ConfigError, LinkBusy, LinkError
from qrobot.rccl_bridge import BridgeServer, BridgeSettings
from qrobot.rccl_bridge.server import _serve
from qrobot.rci import TcpLink, hello_for
from qrobot.realtime import bridge_token
from qrobot.realtime.bridge_token import (
    LONGEST_BYTES,
    arm_of_token,
    offered_token,
    remove_dead_tokens,
    token_for,
    token_name,
)
from tests.support.accounts import OTHER, as_other_account, needs_root
from tests.support.bridge import Bridge
from tests.support.fake_port import FakePort
from tests.support.patience import PATIENCE_S

PORT = 5600

pytestmark = pytest.mark.usefixtures("patient_links")


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    path = Path(tempfile.mkdtemp(dir="/dev/shm"))
    monkeypatch.setenv("QROBOT_RUNTIME_DIR", str(path))
    monkeypatch.delenv("QROBOT_TOKEN", raising=False)
    yield path
    rmtree(path)


def test_a_program_on_this_machine_finds_the_token_while_the_bridge_runs(folder: Path) -> None:
    with offered_token(PORT) as token:
        assert len(token) == 64
        assert (folder / token_name(PORT)).stat().st_mode & 0o777 == 0o600
        assert {token_for(host, PORT) for host in ("127.0.0.1", "localhost", "::1", "127.3.2.1")} == {token}
        assert token_for("192.0.2.1", PORT) == token_for("127.0.0.1", PORT + 1) == b""
    assert token_for("127.0.0.1", PORT) == b""


def test_each_start_has_a_token_of_its_own_also_after_a_kill(folder: Path) -> None:
    with offered_token(PORT) as first:
        left = (folder / token_name(PORT)).read_bytes()
    (folder / token_name(PORT)).write_bytes(left + b"x" * 100)
    (folder / token_name(PORT)).chmod(0o600)
    with offered_token(PORT) as second:
        assert token_for("127.0.0.1", PORT) == second != first


def test_a_token_of_a_living_bridge_is_neither_replaced_nor_removed(folder: Path) -> None:
    with offered_token(PORT) as token:
        with pytest.raises(LinkBusy, match=f"port {PORT}"), offered_token(PORT):
            pass
        assert token_for("127.0.0.1", PORT) == token
    assert not list(folder.iterdir())


def test_a_bridge_removes_what_killed_ones_have_left_and_nothing_else(folder: Path) -> None:
    for name in ("bridge-1.token", "bridge-22.token", "bridge-22.token.old", "puma560-board"):
        (folder / name).write_text("left")
        (folder / name).chmod(0o600)
    (folder / "bridge-3.token").symlink_to(folder / "puma560-board")
    with offered_token(44), offered_token(PORT):
        kept = {"bridge-22.token.old", "puma560-board", "bridge-3.token"}
        assert set(os.listdir(folder)) == {token_name(44), token_name(PORT)} | kept
    assert set(os.listdir(folder)) == kept


@pytest.mark.parametrize("told", [True, False])
def test_a_folder_that_somebody_keeps_locked_keeps_no_bridge_waiting(
    folder: Path, monkeypatch: pytest.MonkeyPatch, told: bool
) -> None:
    monkeypatch.setattr(bridge_token, "PATIENCE_S", 0.0)
    if not told:
        monkeypatch.setattr(bridge_token, "LOCKS", folder / "no-table")
    (folder / token_name(1)).write_text("left")
    locked = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(locked, fcntl.LOCK_EX)
        remove_dead_tokens()
        holder = f"process {os.getpid()}" if told else "another process"
        with pytest.raises(LinkBusy, match=f"{holder} keeps the runtime folder {folder} locked"), offered_token(PORT):
            pass
    finally:
        os.close(locked)
    assert os.listdir(folder) == [token_name(1)]
    with offered_token(PORT) as token:
        assert token_for("127.0.0.1", PORT) == token


def test_a_bridge_waits_while_another_one_starts(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The other one is ready at our second look."""
    locked, looks = os.open(folder, os.O_RDONLY), []
    lock_at_once = bridge_token.lock_alone

    def look(fd: int) -> bool:
        found = lock_at_once(fd)
        looks.append(found)
        fcntl.flock(locked, fcntl.LOCK_UN)
        return found

    monkeypatch.setattr(bridge_token, "PATIENCE_S", PATIENCE_S)
    monkeypatch.setattr(bridge_token, "lock_alone", look)
    fcntl.flock(locked, fcntl.LOCK_EX)
    with offered_token(PORT) as token:
        assert token_for("127.0.0.1", PORT) == token
    os.close(locked)
    assert looks == [False, True, True]


def test_a_file_that_another_program_put_in_its_place_stays(folder: Path) -> None:
    with offered_token(PORT):
        (folder / token_name(PORT)).unlink()
        (folder / token_name(PORT)).write_bytes(b"theirs")
    assert (folder / token_name(PORT)).read_bytes() == b"theirs"


def test_of_two_bridges_that_took_one_port_the_one_that_listens_keeps_its_token(folder: Path) -> None:
    """Two sockets can be bound to one port until one of them listens."""

    async def start_both() -> None:
        first = BridgeServer(FakePort(), BridgeSettings(port=0))
        port = first.take_address().address[1]
        second = BridgeServer(FakePort(), BridgeSettings(port=port))
        second.take_address()
        ready = asyncio.Event()
        serving = asyncio.create_task(_serve(first, lambda *_: ready.set()))
        await ready.wait()
        with pytest.raises(LinkBusy):
            await _serve(second, None)
        assert token_for("127.0.0.1", port) == first.token
        assert second.token == b""
        serving.cancel()
        await asyncio.gather(serving, return_exceptions=True)

    asyncio.run(start_both())
    assert not list(folder.iterdir())


@pytest.mark.parametrize("arm", ["", "left", "a" * 32])
def test_it_tells_which_arm_its_bridge_has(folder: Path, arm: str) -> None:
    with offered_token(PORT, arm) as token:
        assert arm_of_token(token) == arm_of_token(token_for("127.0.0.1", PORT)) == arm
        assert len(token) <= LONGEST_BYTES


@pytest.mark.parametrize("token", ["", "a" * 64, "my:word", f"{'a' * 63}g:left", f"{'a' * 64}:", f"{'a' * 64}:a b"])
def test_a_word_of_somebody_s_own_names_no_arm(token: str) -> None:
    assert arm_of_token(token.encode()) == ""


@pytest.mark.parametrize(
    ("has", "wanted", "refused"),
    [("left", "right", True), ("left", "left", False), ("", "left", False), ("left", "", False)],
)
def test_a_commander_of_one_arm_does_not_greet_the_bridge_of_another(
    folder: Path, has: str, wanted: str, refused: bool
) -> None:
    with Bridge() as bridge, offered_token(bridge.server.address[1], has) as bridge.server.token:
        link = TcpLink(hello_for("puma560"), bridge.server.address, arm=wanted)
        if refused:
            with pytest.raises(ConfigError, match=r"is that of arm 'left', not of 'right': --deployment"):
                link.open()
        else:
            assert link.open().robot == "puma560"
        link.close()


def test_the_variable_comes_before_the_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("QROBOT_TOKEN", "given\n")
    with offered_token(PORT):
        assert token_for("127.0.0.1", PORT) == token_for("192.0.2.1", 1) == b"given"
    assert folder.exists()


@needs_root
def test_another_account_cannot_read_it_and_a_program_of_it_is_refused(folder: Path) -> None:
    with Bridge() as bridge:
        address = bridge.server.address
        with offered_token(address[1]) as bridge.server.token:
            assert "LinkError: the runtime folder" in as_other_account(lambda: token_for(*address))

            def command() -> str:
                link = TcpLink(hello_for("puma560"), address)
                link.open()
                return "it commands"

            link = TcpLink(hello_for("puma560"), address)
            link.open()
            link.close()
            assert "LinkError" in as_other_account(command)
        bridge.server.token = b"another"
        stranger = TcpLink(hello_for("puma560"), address)
        with pytest.raises(LinkError, match="QROBOT_TOKEN"):
            stranger.open()
        stranger.close()


@needs_root
def test_a_shared_folder_lets_its_group_read_the_token(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("qrobot.realtime.runtime_folder.GROUP", "nogroup")
    os.chown(folder, 0, OTHER)
    folder.chmod(0o750)
    with offered_token(PORT) as token:
        assert as_other_account(lambda: token_for("127.0.0.1", PORT).decode()) == token.decode()
