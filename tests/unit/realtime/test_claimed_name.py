"""A name that one process holds at a time, whatever becomes of the runtime folder."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import uuid
from pathlib import Path

import pytest

from qrobot.realtime import claimed_name
from qrobot.realtime.claimed_name import UNKNOWN, claimed
from tests.support.accounts import OTHER, needs_root

HOLDS = (
    "import sys; from qrobot.realtime.claimed_name import claimed\n"
    "with claimed(sys.argv[1]) as holder: print(holder, flush=True); sys.stdin.read()"
)


@pytest.fixture
def name() -> str:
    return f"servo {uuid.uuid4().hex}"


def held_by_another(name: str) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDS, name], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "0\n"
    return process


def test_a_name_is_held_until_its_process_ends_however_it_does(name: str) -> None:
    other = held_by_another(name)
    with claimed(name) as holder:
        assert holder == other.pid
    other.kill()
    other.communicate()
    for _ in range(2):
        with claimed(name) as holder:
            assert holder == 0


def test_however_often_it_is_asked_for_a_name_is_held_once(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """As by a service that is started again and again: the kernel keeps so many visitors, and no more."""
    monkeypatch.setattr(claimed_name, "_MOST_VISITORS", 2)
    with claimed(name):
        holders = []
        for _ in range(6):
            with claimed(name) as holder:
                holders.append(holder)
    assert set(holders) == {os.getpid(), UNKNOWN}
    assert holders[-1] == UNKNOWN


def test_another_runtime_folder_has_names_of_its_own(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with claimed(name):
        monkeypatch.setenv("QROBOT_RUNTIME_DIR", str(tmp_path))
        with claimed(name) as holder:
            assert holder == 0


@needs_root
def test_what_another_account_holds_keeps_nobody_from_anything(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    addresses: list[str] = []
    with monkeypatch.context() as patch, claimed(name):
        patch.setattr(claimed_name, "_holder", addresses.append)
        with claimed(name):
            pass
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.setresuid(OTHER, OTHER, OTHER)
        theirs = socket.socket(socket.AF_UNIX)
        theirs.bind(addresses[0])
        theirs.listen()
        os.write(write, b"!")
        signal.pause()
    assert os.read(read, 1) == b"!"
    with claimed(name) as holder:
        assert holder == 0
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
