"""`qrobot inject` and `qrobot board --fault`: what they print, refuse and do to a board that runs."""

from __future__ import annotations

import json
import uuid
from collections.abc import Iterator
from pathlib import Path

import pytest

from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.config import load_robot
from qrobot.hwif.board_memory import create_board_memory
from qrobot.realtime.shared_memory import SharedMemory
from qrobot.sim_board.emulator import Emulator, emulator_run
from qrobot.sim_board.faults import KINDS


@pytest.fixture
def arm() -> str:
    return f"test{uuid.uuid4().hex[:10]}"


@pytest.fixture
def deployment(tmp_path: Path, arm: str) -> str:
    path = tmp_path / "lab.toml"
    path.write_text(f'[[arm]]\nname = "{arm}"\nrobot = "puma560"\nbridge = {{ port = 5000 }}\n')
    return str(path)


@pytest.fixture
def board(arm: str) -> Iterator[SharedMemory]:
    segment = create_board_memory(arm)
    yield segment
    segment.close(unlink=True)


def run(*tokens: str) -> int:
    return run_app(make_app(), ["inject", *tokens])


def test_everything_that_can_break_is_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--list") == 0
    printed = capsys.readouterr().out
    for kind in KINDS:
        assert kind.address in printed
        assert kind.name in printed
    assert run("--list", "--json") == 0
    assert [row["number"] for row in json.loads(capsys.readouterr().out)] == [kind.number for kind in KINDS]


def test_help_teaches_by_examples(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--help") == 0
    assert '"encoder:2 stuck @1.5s +0.5s"' in " ".join(capsys.readouterr().out.replace("│", " ").split())


def test_what_is_injected_acts_and_is_reported_until_it_is_cleared(
    board: SharedMemory, deployment: str, capsys: pytest.CaptureFixture[str]
) -> None:
    emulator = Emulator(load_robot("puma560"), physics="rigid")
    emulator.connect(board.memory, 1_000_000)
    assert run("encoder:2 jump 3000", "estop pressed @1s", "--deployment", deployment) == 0
    assert "waiting" in capsys.readouterr().out
    emulator_run(emulator.bundle, board.memory, 1_000_000, 3)
    assert run("--deployment", deployment, "--json") == 0
    first, second = json.loads(capsys.readouterr().out)
    assert first == {"fault": "encoder:2 jump 3000", "steps": 3, "acted": 1, "over": False}
    assert second["steps"] == 0
    assert run("--deployment", deployment, "--clear") == 0
    assert "nothing is broken" in capsys.readouterr().out
    assert board.memory.faults.used == 0


def test_one_bad_line_injects_nothing(board: SharedMemory, deployment: str, capsys: pytest.CaptureFixture[str]) -> None:
    Emulator(load_robot("puma560"), physics="rigid").connect(board.memory, 1)
    assert run("estop pressed", "encoder:2 stuk", "--deployment", deployment) == 1
    assert "did you mean 'stuck'?" in capsys.readouterr().err
    assert board.memory.faults.used == 0


@pytest.mark.usefixtures("board")
def test_a_board_that_is_not_emulated_cannot_be_broken(deployment: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("estop pressed", "--deployment", deployment) == 1
    assert "no emulated one" in capsys.readouterr().err


def test_without_a_board_it_says_so(deployment: str, arm: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("estop pressed", "--deployment", deployment) == 1
    assert arm in capsys.readouterr().err


def test_a_board_refuses_a_fault_it_cannot_have_before_it_starts(
    deployment: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_app(make_app(), ["board", deployment, "--fault", "brake:9 stuck"]) == 1
    assert "which joint?" in capsys.readouterr().err
