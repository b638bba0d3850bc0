"""Processes of the pendant that die, hang, flood their output, leave others behind, or outlive it: real ones."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from qrobot.pendant import command_run
from qrobot.pendant.command_run import CommandRun
from tests.support.patience import PATIENCE_S, wait_until

pytestmark = pytest.mark.realtime

PYTHON = (sys.executable, "-u", "-I", "-S", "-c")


def run_of(*scripts: str, lines: tuple[str, ...] = ()) -> CommandRun:
    return CommandRun([[script] for script in scripts], lambda: None, lines=lines, program=PYTHON)


def printed(run: CommandRun) -> list[str]:
    return run.output.since(0).lines


def says(run: CommandRun, text: str) -> Callable[[], bool]:
    return lambda: text in printed(run)


def lives(process: str) -> bool:
    """A process that is no zombie has this number."""
    try:
        return Path("/proc", process, "stat").read_text().rpartition(") ")[2][0] != "Z"
    except OSError:
        return False


def test_commands_run_one_after_the_other_until_one_fails() -> None:
    run = run_of("print('one')", "print(input()); print(input())", lines=("two", "three"))
    run.wait(PATIENCE_S)
    assert (run.state, printed(run)) == ("done", ["one", "two", "three"])
    run = run_of("import sys; sys.exit('no')", "print('never')")
    run.wait(PATIENCE_S)
    assert (run.state, printed(run)) == ("failed", ["no"])
    assert "status 1" in run.told
    run = run_of("import os; os.kill(os.getpid(), 9)")
    run.wait(PATIENCE_S)
    assert run.told == "it was killed by SIGKILL"


def test_one_that_is_interrupted_ends_by_itself_and_one_that_does_not_listen_is_killed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(command_run, "INTERRUPTED_S", PATIENCE_S)
    run = run_of("try: print('up'); input()\nexcept KeyboardInterrupt: print('at rest')\nexcept EOFError: input")
    wait_until(says(run, "up"), "it runs")
    run.interrupt()
    run.wait(PATIENCE_S)
    assert (run.state, printed(run)) == ("done", ["up", "at rest"])
    monkeypatch.setattr(command_run, "INTERRUPTED_S", 0.05)
    run = run_of("import signal, time\nsignal.signal(2, signal.SIG_IGN); print('deaf')\nwhile 1: time.sleep(9)")
    wait_until(says(run, "deaf"), "it runs")
    run.end()
    run.wait(PATIENCE_S)
    assert run.state == "ended"
    assert "was killed" in run.told


def test_one_that_floods_its_output_is_ended_at_once_and_what_it_left_running_ends_too() -> None:
    run = run_of(
        "import os, time\n"
        "if not (child := os.fork()): time.sleep(900)\n"
        "print(child, flush=True)\n"
        "while 1: print('flood ' * 100)\n"
    )
    wait_until(lambda: len(printed(run)) > 100, "it floods")
    run.end()
    run.wait(PATIENCE_S)
    assert run.state == "ended"
    wait_until(lambda: not lives(printed(run)[0]), "its child ends with it")
    run = run_of("import os, time\nif not (child := os.fork()): os.setsid(); time.sleep(900)\nprint(child)")
    run.wait(PATIENCE_S)  # somebody who has left the group still holds its output open
    assert run.state == "done"
    (child,) = printed(run)
    os.kill(int(child), signal.SIGKILL)


def test_it_is_interrupted_when_the_pendant_is_killed(tmp_path: Path) -> None:
    kept = tmp_path / "kept"
    inner = (
        "import os, time, pathlib\n"
        f"kept = pathlib.Path({str(kept)!r})\n"
        "try: print('up', flush=True); time.sleep(900)\n"
        "except KeyboardInterrupt: kept.write_text('at rest')\n"
    )
    outer = (
        "import sys, time\nfrom qrobot.pendant.command_run import CommandRun\n"
        f"run = CommandRun([[{inner!r}]], lambda: None, program={PYTHON!r})\n"
        "while not run.output.since(0).lines: time.sleep(0.01)\n"
        "print('up', flush=True); time.sleep(900)\n"
    )
    pendant = subprocess.Popen([sys.executable, "-c", outer], stdout=subprocess.PIPE, env=os.environ)
    assert pendant.stdout is not None
    assert pendant.stdout.readline() == b"up\n"
    pendant.kill()
    pendant.communicate()
    wait_until(kept.exists, "interrupted")


def test_what_cannot_be_started_is_told() -> None:
    run = CommandRun([["x"]], lambda: None, program=["/nowhere/python"])
    run.wait(PATIENCE_S)
    assert run.state == "failed"
