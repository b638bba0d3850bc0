"""`qrobot board check` as people and scripts call it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import uuid
from collections.abc import Iterator
from pathlib import Path

import pytest

from qrobot.cli.console import FAILURE, INTERRUPTED
from qrobot.config import load_robot
from qrobot.hwif.registers import DAC_ZERO, DISCRETE, DISCRETE_POWER
from qrobot.hwif.trace import read_trace
from qrobot.rig.board_check import STEPS
from qrobot.servo.memory.servo_memory import create_servo_memory
from qrobot.servo.memory.telemetry import SMALLEST_RING
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.server import EmulatedBoardServer
from tests.support.patience import PATIENCE_S, wait_until
from tests.support.processes import qrobot
from tests.support.signals import default_signals

pytestmark = pytest.mark.realtime


@pytest.fixture(scope="module")
def server() -> Iterator[EmulatedBoardServer]:
    with EmulatedBoardServer(f"t{uuid.uuid4().hex[:10]}", Emulator(load_robot("puma560"))) as server:
        yield server


@pytest.fixture
def deployment(server: EmulatedBoardServer, tmp_path: Path) -> Path:
    name = server.segment.path.name.removesuffix("-board")
    path = tmp_path / "arms.toml"
    path.write_text(f'[[arm]]\nname = "{name}"\nrobot = "puma560"\nbridge = {{ port = 5999 }}\n')
    return path


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    with qrobot("board", "check", *arguments) as process:
        out, errors = process.communicate(timeout=PATIENCE_S)
    return subprocess.CompletedProcess(process.args, process.returncode, out, errors)


def test_a_script_gets_every_finding_and_the_board_is_left_safe(server: EmulatedBoardServer, deployment: Path) -> None:
    done = run(deployment, "--yes", "--power", "--json")
    report = json.loads(done.stdout)
    assert [finding for finding in report["findings"] if finding["ok"] is False] == []
    assert (done.returncode, report["good"]) == (0, True)
    assert [finding["step"] for finding in report["findings"]] == [step.name for step in STEPS]
    left_out = [step.name for step in STEPS if step.hands]
    assert [finding["step"] for finding in report["findings"] if finding["ok"] is None] == left_out
    assert not server.emulator.powered
    assert (server.emulator.bundle.board.dac == DAC_ZERO).all()


@pytest.mark.sampled(1)
@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGTERM])
def test_a_walk_that_is_ended_in_the_middle_of_a_push_leaves_the_board_safe(
    server: EmulatedBoardServer, deployment: Path, number: signal.Signals
) -> None:
    board, memory = server.emulator.bundle.board, server.segment.memory
    with default_signals(signal.SIGHUP), qrobot("board", "check", deployment, "--yes", "--power") as process:
        wait_until(lambda: bool((board.dac != DAC_ZERO).any()), "a push")
        process.send_signal(number)
        process.communicate(timeout=PATIENCE_S)
    assert process.returncode == INTERRUPTED
    assert (board.dac == DAC_ZERO).all()
    discrete = [row[3] for row in read_trace(memory) if row[2] == DISCRETE]
    assert not discrete[-1] & DISCRETE_POWER


def test_a_dry_run_writes_nothing_and_says_what_it_left_out(server: EmulatedBoardServer, deployment: Path) -> None:
    before = len(read_trace(server.segment.memory))
    done = run(deployment, "--read-only")
    assert done.returncode == 0
    assert "✔ status" in done.stdout
    assert "· outputs to zero: left out: it writes" in done.stdout
    assert len(read_trace(server.segment.memory)) == before


def test_it_does_not_write_beside_a_servo(server: EmulatedBoardServer, deployment: Path) -> None:
    arm = server.segment.path.name.removesuffix("-board")
    with create_servo_memory(arm, "puma560", "pd", 6, 1_000_000, SMALLEST_RING):
        done = run(deployment, "--yes")
    assert done.returncode == FAILURE
    assert "end it first" in done.stderr


def test_without_anybody_to_ask_it_says_what_to_do(deployment: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "qrobot", "board", "check", deployment],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == FAILURE
    assert "--yes" in done.stderr
