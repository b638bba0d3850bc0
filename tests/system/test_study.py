"""Studies of real arms in lock-step: small, but all of it."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from contextlib import suppress
from multiprocessing import active_children
from pathlib import Path

import numpy as np
import pytest

from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.errors import LinkError
from qrobot.ident.fit import NORMAL_95
from qrobot.study.campaign import carry_out
from qrobot.study.engine import Engine, InProcess, engine
from qrobot.study.gains import GainStudy
from qrobot.study.results import Results, read_results
from tests.support.patience import wait_until

ROOT = Path(__file__).parents[2]
LISTEN = "0A"  # a state, as /proc/net/tcp has it
PAIRS = GainStudy(bandwidths=(0.5, 1.0), dampings=(1.0,))


@pytest.fixture(scope="module")
def gains(tmp_path_factory: pytest.TempPathFactory) -> Results:
    """Two arms, each with two pairs of gains, in this process."""
    return carry_out(PAIRS, 2, Engine(InProcess(), 1, 1), tmp_path_factory.mktemp("gains") / "r.jsonl")


@pytest.mark.thorough
def test_a_stiffer_servo_tracks_better_and_chatters_more(gains: Results) -> None:
    for outcome in gains.good:
        soft, stiff = outcome["tried"]
        assert 0.0 < stiff["rms"] < soft["rms"] < soft["largest"] < 1.0
        assert stiff["chatter"] > soft["chatter"] > 0.0


@pytest.mark.thorough
def test_two_processes_find_what_one_process_finds_and_open_no_port(gains: Results, tmp_path: Path) -> None:
    before = ports_of([os.getpid()])
    with engine(2) as both:
        assert both.workers == 2
        assert carry_out(PAIRS, 2, both, tmp_path / "r.jsonl") == gains
        workers = [child.pid for child in active_children() if child.pid is not None]
        assert len(workers) >= 2
        assert ports_of([os.getpid(), *workers]) == before


def test_a_worker_that_is_killed_is_told() -> None:
    with pytest.raises(LinkError, match="a worker was killed"), engine(2) as both:
        both.executor.submit(os._exit, 1).result()


def test_workers_open_no_port() -> None:
    before = ports_of([os.getpid()])
    with engine(2) as both:
        both.executor.submit(os.getpid).result()
        workers = [child.pid for child in active_children() if child.pid is not None]
        assert workers
        assert ports_of([os.getpid(), *workers]) == before


PROGRAM = """
import os, time
from qrobot.study.engine import engine
if __name__ == "__main__":
    with engine(2) as both:
        print(both.executor.submit(os.getpid).result(), flush=True)
        time.sleep(1000)
"""


@pytest.mark.realtime
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_workers_end_with_who_gives_them_work(tmp_path: Path, number: signal.Signals) -> None:
    path = tmp_path / "program.py"
    path.write_text(PROGRAM)
    with subprocess.Popen([sys.executable, path], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        worker = int(process.stdout.readline())
        open_file = Path(f"/proc/{worker}/fd/0")  # a process that has ended has none, though nobody has waited for it
        assert open_file.is_symlink()
        process.send_signal(number)
        wait_until(lambda: not open_file.is_symlink(), "the worker has ended")


def ports_of(processes: list[int]) -> set[str]:
    """Addresses at which these processes listen, as the kernel writes them."""
    held = set[str]()
    for file in [file for process in processes for file in Path(f"/proc/{process}/fd").iterdir()]:
        with suppress(FileNotFoundError):  # closed since
            held.add(os.readlink(file))
    tables = [Path("/proc/net/tcp"), Path("/proc/net/tcp6")]
    rows = [line.split() for table in tables if table.exists() for line in table.read_text().splitlines()[1:]]
    return {row[1] for row in rows if row[3] == LISTEN and f"socket:[{row[9]}]" in held}


@pytest.mark.thorough
def test_an_arm_is_identified_and_judged_from_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    path = tmp_path / "arms.jsonl"
    words = ["--arms", "1", "--poses", "12", "--no-tracking", "--workers", "1", "--output", str(path)]
    words += ["--rate", "250", "--stiction", "1.3", "--torque", "known", "--dynamic"]
    assert run_app(make_app("study"), ["study", "identify", *words]) == 0
    assert "are inside their 95 % intervals" in " ".join(capsys.readouterr().out.split())
    outcome = read_results(path).good[0]
    gravity, before = np.array(outcome["gravity_rms"]), np.array(outcome["gravity_before"])
    assert (gravity[1:3] < 0.05 * before[1:3]).all()
    assert np.abs(outcome["friction_error"]).max() < 0.02
    inertia = outcome["inertia"]
    assert np.linalg.norm(inertia["after"]) < 0.6 * np.linalg.norm(inertia["before"])
    assert np.mean(np.abs(list(inertia["deviations"].values())) < NORMAL_95) > 0.8
    assert run_app(make_app("study"), ["study", "show", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["arms"] == 1


def test_the_program_of_the_page_runs() -> None:
    page = (ROOT / "docs/how-to/try-many-arms.md").read_text()
    program = re.search(r"```python\n(.*?)```", page, re.DOTALL)
    assert program is not None
    exec(compile(program[1], "try-many-arms.md", "exec"), {})
