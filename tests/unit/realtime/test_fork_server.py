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
from qrobot.realtime import forked_process, forking
from qrobot.realtime.forked_process import UNKNOWN_STATUS, ForkedProcess, is_readable
from qrobot.realtime.forking import ForkServer
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
                    big=len(os.environ.get("BIG", "")),
                    ignored=[number for number in (1, 2, 15) if signal.getsignal(number) is signal.SIG_IGN],
                    descriptors=sorted(map(int, os.listdir("/proc/self/fd"))), given=sorted(map(int, numbers)))
        print(json.dumps(told))
        print("a complaint", file=sys.stderr)
    elif sys.argv[1] == "exit":
        sys.exit(int(sys.argv[2]))
    elif sys.argv[1] == "read":
        input()
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
    monkeypatch.setenv("BIG", "x" * 1_000_000)  # more than fits in a message
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
    assert told["big"] == 1_000_000
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


@pytest.mark.parametrize(
    ("word", "complaint"), [("nonsense", "ValueError: nonsense"), ("read", "EOFError: EOF when reading a line")]
)
def test_an_error_leaves_its_traceback_and_status_1(
    server: ForkServer, tmp_path: Path, word: str, complaint: str
) -> None:
    assert start(server, tmp_path / "out.txt", word).wait(PATIENCE_S) == 1
    assert (tmp_path / "out.txt").read_text().splitlines()[-1] == complaint


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


CLIENT = f"""
import os, sys
from qrobot.realtime.forking import ForkServer
server = ForkServer("{MODULE}:run", ["{MODULE}"])
def end(*_):
    os.kill(os.getpid(), 9)
if sys.argv[1] == "at once":
    end()
server.wait_ready()
if sys.argv[1] == "ready":
    end()
server._receive = end  # an answer is there, and nobody takes it
with open(os.devnull, "wb") as output:
    server.fork(("qrobot", "exit", "0"), output.fileno(), {{}})
"""


@pytest.mark.parametrize("when", ["at once", "ready", "answered"])
def test_a_fork_server_ends_with_its_client_whenever_that_ends_and_says_nothing(folder: Path, when: str) -> None:
    environment = {**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
    done = subprocess.run(  # returns when nobody has its output open any more
        [sys.executable, "-c", CLIENT, when],
        env=environment, stderr=subprocess.PIPE, timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (-signal.SIGKILL, b"")


def test_what_a_process_prints_comes_where_its_client_has_no_stderr(folder: Path, tmp_path: Path) -> None:
    client = (
        "from qrobot.realtime.forking import ForkServer\n"
        f"server = ForkServer('{MODULE}:run', ['{MODULE}'])\n"
        "with open('out.txt', 'wb') as output:\n"
        "    status = server.fork(('qrobot', 'nonsense'), output.fileno(), {}).wait()\n"
        "server.close()\n"
        "raise SystemExit(status)\n"
    )
    environment = {**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
    command = ["sh", "-c", 'exec "$@" 2>&-', "sh", sys.executable, "-c", client]
    assert subprocess.run(command, cwd=tmp_path, env=environment, timeout=PATIENCE_S, check=False).returncode == 1
    assert "ValueError: nonsense" in (tmp_path / "out.txt").read_text()


def test_a_process_is_started_in_a_folder_that_is_gone(
    server: ForkServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert start(server, tmp_path / "out.txt", "exit", "3").wait(PATIENCE_S) == 3


def test_where_the_kernel_has_no_descriptors_of_processes_there_is_no_fork_server(tmp_path: Path) -> None:
    (tmp_path / f"{MODULE}.py").write_text(SOURCE)
    (tmp_path / "sitecustomize.py").write_text("import os\ndel os.pidfd_open\n")
    server = opened(tmp_path)
    with pytest.raises(LinkLost, match="has ended"):
        server.wait_ready()
    server.close()


def test_a_process_that_its_client_does_not_come_to_know_does_nothing(
    server: ForkServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    server.wait_ready()
    receive, kept = server._receive, list[int]()

    def lost() -> tuple[bytes, list[int]]:
        """As where this process may open no more files."""
        told, descriptors = receive()
        kept.extend(descriptors)
        return told, []

    with monkeypatch.context() as patch:
        patch.setattr(server, "_receive", lost)
        with pytest.raises(LinkLost, match="cannot fork"):
            start(server, tmp_path / "out.txt", "nonsense")
    (process,) = kept
    assert is_readable(process, PATIENCE_S)  # it has ended
    os.close(process)
    assert (tmp_path / "out.txt").read_text() == ""
    assert start(server, tmp_path / "next.txt", "exit", "0").wait(PATIENCE_S) == 0


def test_an_order_that_comes_without_its_descriptors_is_refused(
    server: ForkServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ask = server._ask
    for left in (1, 4, 5):
        with monkeypatch.context() as patch:
            patch.setattr(server, "_ask", lambda descriptors, left=left: ask(descriptors[:left]))
            with pytest.raises(LinkLost, match="descriptors of its order have not come"):
                start(server, tmp_path / "out.txt", "exit", "0")
    assert start(server, tmp_path / "out.txt", "exit", "0").wait(PATIENCE_S) == 0


def test_a_fork_server_that_stands_still_keeps_nobody_waiting(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    server = opened(folder)
    process = waits(server, tmp_path / "out.txt")
    monkeypatch.setattr(forked_process, "TELL_S", 0.0)
    monkeypatch.setattr(forking, "ANSWER_S", 0.0)
    os.kill(server._process.pid, signal.SIGSTOP)
    process.kill()
    assert process.wait(PATIENCE_S) == UNKNOWN_STATUS
    with pytest.raises(LinkLost, match="has not answered within 0 s"):
        start(server, tmp_path / "other.txt", "nonsense")
    with pytest.raises(LinkLost):
        start(server, tmp_path / "other.txt", "nonsense")
    server.close()
    assert (tmp_path / "other.txt").read_text() == ""


def test_a_time_that_is_over_is_not_waited_for(server: ForkServer, tmp_path: Path) -> None:
    process = waits(server, tmp_path / "out.txt")
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(-1.0)
    process.kill()
    assert process.wait(PATIENCE_S) == -signal.SIGKILL


def test_many_processes_at_a_time_are_told_apart(server: ForkServer, tmp_path: Path) -> None:
    processes = [start(server, tmp_path / f"{k}.txt", "exit", str(k)) for k in range(20)]
    assert len({process.pid for process in processes}) == 20
    assert [process.wait(PATIENCE_S) for process in processes] == list(range(20))
