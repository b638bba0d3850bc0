"""What processes of a rig are forked from, and what becomes of them without it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from qrobot.realtime.forked_process import ForkedProcess
from qrobot.realtime.forking import ONE_BLAS_THREAD, ForkServer
from qrobot.rig.process_starter import PREPARATIONS, ProcessStarter
from tests.support.patience import PATIENCE_S
from tests.support.processes import shared_starter

THREADS = """
import os, sys
from qrobot.realtime.fork_server import _prepare
for name in sys.argv[1:]:
    _prepare(name)
print(len(os.listdir("/proc/self/task")))
"""


def version(starter: ProcessStarter, output: Path) -> tuple[type, int, str]:
    with output.open("wb") as file:
        process = starter.start(("--version",), file, {})
    return type(process), process.wait(PATIENCE_S), output.read_text()


def test_processes_are_forked_when_that_was_prepared_and_started_afresh_else(tmp_path: Path) -> None:
    afresh = version(ProcessStarter(), tmp_path / "afresh.txt")
    starter = shared_starter()
    starter.prepare()
    forked = version(starter, tmp_path / "forked.txt")
    assert (afresh[0], forked[0]) == (subprocess.Popen, ForkedProcess)
    assert afresh[1:] == forked[1:]
    assert afresh[1] == 0
    assert afresh[2]


@pytest.mark.thorough
def test_a_starter_whose_fork_server_was_killed_starts_processes_afresh(tmp_path: Path) -> None:
    starter = ProcessStarter()
    starter.prepare()
    assert starter._forks is not None
    starter._forks._process.kill()
    starter.prepare()
    kind, status, _ = version(starter, tmp_path / "out.txt")
    assert (kind, status) == (subprocess.Popen, 0)
    starter.close()


def test_an_interrupt_while_libraries_are_imported_leaves_no_fork_server(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[ForkServer] = []

    def interrupted(server: ForkServer) -> None:
        made.append(server)
        raise KeyboardInterrupt

    monkeypatch.setattr(ForkServer, "wait_ready", interrupted)
    starter = ProcessStarter()
    with pytest.raises(KeyboardInterrupt):
        starter.prepare()
    assert made[0]._process.returncode is not None
    starter.close()


def test_every_preparation_works_and_leaves_one_thread_for_others_do_not_survive_a_fork() -> None:
    done = subprocess.run(
        [sys.executable, "-c", THREADS, *PREPARATIONS],
        capture_output=True, text=True, timeout=PATIENCE_S, check=False,
        env={**os.environ, **ONE_BLAS_THREAD},
    )  # fmt: skip
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, "1", "")
