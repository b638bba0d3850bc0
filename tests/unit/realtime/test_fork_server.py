"""Processes that are forked with their libraries: what they are given, how they end, and what outlives whom."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from qrobot.errors import LinkLost
from qrobot.realtime.fork_server import UNKNOWN_STATUS, ForkedProcess, ForkServer
from qrobot.realtime.signals import handled
from tests.support.patience import PATIENCE_S

MODULE = "forked_by_tests"
SOURCE = """
import json, os, signal, sys, threading, time
PREPARED = []
def prepare():
    PREPARED.append(os.getpid())
def broken():
    raise RuntimeError("left to who needs it")
def run():
    if sys.argv[1] == "tell":
        numbers = os.environ["GIVEN"].split(",")
        for number in map(int, numbers):
            os.write(number, b"from the child")
        told = dict(words=sys.argv, prepared=PREPARED, me=os.getpid(), session=os.getsid(0), folder=os.getcwd(),
                    color=os.environ.get("COLOR"), old=os.environ.get("OLD"), threads=threading.active_count(),
                    title=open("/proc/self/cmdline").read().strip("\\0"), input=sys.stdin.read(),
                    ignored=[number for number in (1, 2, 15) if signal.getsignal(number) is signal.SIG_IGN],
                    descriptors=sorted(map(int, os.listdir("/proc/self/fd"))), given=sorted(map(int, numbers)))
        print(json.dumps(told))
        print("a complaint", file=sys.stderr)
    elif sys.argv[1] == "exit":
        sys.exit(int(sys.argv[2]))
    elif sys.argv[1] == "wait":
        print("waits", flush=True)
        time.sleep(600)
    else:
        raise ValueError(sys.argv[1])
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Has the module that is run."""
    found = tmp_path_factory.mktemp("modules")
    (found / f"{MODULE}.py").write_text(SOURCE)
    return found


def opened(folder: Path, *preparations: str) -> ForkServer:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(folder), prepend=os.pathsep)
        patch.setenv("OLD", "of the fork server")
        return ForkServer(f"{MODULE}:run", (MODULE, *preparations))


@pytest.fixture(scope="module")
def server(folder: Path) -> Iterator[ForkServer]:
    """With a preparation that works, and two that do not."""
    found = opened(folder, f"{MODULE}:prepare", f"{MODULE}:broken", "no_such_library")
    yield found
    found.close()


def start(server: ForkServer, output: Path, *words: str) -> ForkedProcess:
    with output.open("wb") as file, open(os.devnull, "wb") as given:
        return server.fork(("qrobot", *words), file.fileno(), {"GIVEN": [given.fileno()]})


def waits(server: ForkServer, output: Path) -> ForkedProcess:
    """A process that runs until it is ended."""
    process = start(server, output, "wait")
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.0)
    assert process.poll() is None
    return process


def test_a_process_has_what_was_prepared_and_what_it_is_given_and_nothing_else(
    server: ForkServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLOR", "green")
    monkeypatch.delenv("OLD", raising=False)
    other = waits(server, tmp_path / "other.txt")  # its descriptors are nobody else's
    read, write = os.pipe()
    second_read, second = os.pipe()
    with (tmp_path / "out.txt").open("wb") as file, handled({signal.SIGHUP: signal.SIG_IGN}):
        process = server.fork(("qrobot", "tell", "a b", "--c"), file.fileno(), {"GIVEN": [write, second]})
    for end in (write, second):
        os.close(end)
    assert process.wait(PATIENCE_S) == 0
    assert [os.read(end, 100) + os.read(end, 100) for end in (read, second_read)] == [b"from the child"] * 2
    for end in (read, second_read):
        os.close(end)
    other.kill()
    assert other.wait(PATIENCE_S) == -signal.SIGKILL

    line, complaint = (tmp_path / "out.txt").read_text().splitlines()
    told = json.loads(line)
    assert complaint == "a complaint"
    assert told["words"] == ["qrobot", "tell", "a b", "--c"]
    assert told["title"].startswith("qrobot tell a b --c")
    assert told["folder"] == str(tmp_path)
    assert (told["color"], told["old"], told["input"], told["threads"]) == ("green", None, "", 1)
    assert told["ignored"] == [signal.SIGHUP]
    assert told["me"] == told["session"] == process.pid
    assert len(told["prepared"]) == 1
    assert told["prepared"] != [process.pid]
    listing = 1  # the folder that lists them
    assert len(told["descriptors"]) == 3 + len(told["given"]) + listing


@pytest.mark.parametrize("status", [0, 1, 130])
def test_an_exit_status_is_told(server: ForkServer, tmp_path: Path, status: int) -> None:
    process = start(server, tmp_path / "out.txt", "exit", str(status))
    assert process.wait(PATIENCE_S) == status
    assert (process.poll(), process.returncode) == (status, status)
    process.kill()  # nobody


def test_an_error_leaves_its_traceback_and_status_1(server: ForkServer, tmp_path: Path) -> None:
    assert start(server, tmp_path / "out.txt", "nonsense").wait(PATIENCE_S) == 1
    assert (tmp_path / "out.txt").read_text().splitlines()[-1] == "ValueError: nonsense"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_the_signal_that_ended_a_process_is_told(server: ForkServer, tmp_path: Path, number: signal.Signals) -> None:
    process = waits(server, tmp_path / "out.txt")
    process.send_signal(number)
    assert process.wait(PATIENCE_S) == -number


def test_processes_outlive_a_fork_server_that_is_killed_which_is_told_and_can_be_ended(
    folder: Path, tmp_path: Path
) -> None:
    server = opened(folder)
    process = waits(server, tmp_path / "out.txt")
    server._process.kill()
    server._process.wait()
    with pytest.raises(LinkLost, match="fork server has ended"):
        start(server, tmp_path / "other.txt", "exit", "0")
    server.close()
    assert process.poll() is None
    process.send_signal(signal.SIGTERM)
    assert process.wait(PATIENCE_S) == UNKNOWN_STATUS


def test_a_fork_server_ends_with_its_client_however_that_ends(folder: Path) -> None:
    program = (
        "import os, sys\n"
        "from qrobot.realtime.fork_server import ForkServer\n"
        f"server = ForkServer({f'{MODULE}:run'!r}, [{MODULE!r}])\n"
        "if sys.argv[1] == 'ready': server.wait_ready()\n"
        "os.kill(os.getpid(), 9)\n"
    )
    environment = {**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
    for when in ("ready", "at once"):
        done = subprocess.run(  # returns when nobody has its output open any more
            [sys.executable, "-c", program, when],
            env=environment, stderr=subprocess.PIPE, timeout=PATIENCE_S, check=False,
        )  # fmt: skip
        assert (done.returncode, done.stderr) == (-signal.SIGKILL, b"")


def test_many_processes_at_a_time_are_told_apart(server: ForkServer, tmp_path: Path) -> None:
    processes = [start(server, tmp_path / f"{k}.txt", "exit", str(k)) for k in range(20)]
    assert len({process.pid for process in processes}) == 20
    assert [process.wait(PATIENCE_S) for process in processes] == list(range(20))
