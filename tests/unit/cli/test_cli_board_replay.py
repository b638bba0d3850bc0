"""`qrobot board --record` and `qrobot board replay`: what went over a transport, written down and told."""

from __future__ import annotations

import contextlib
import json
import os
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from qrobot.cli.board import board
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.hwif.registers import N_DACS
from qrobot.hwif.transports import Transport
from tests.support.bus import BenchEndpoint, DirectBus

EXCHANGES = 5


class Soon(threading.Event):
    """Somebody presses Ctrl-C after so many exchanges: the gateway waits once after each."""

    def __init__(self) -> None:
        super().__init__()
        self.waits = 0

    def wait(self, _timeout: float | None = None) -> bool:
        self.waits += 1
        if self.waits == EXCHANGES:
            self.set()
        return self.is_set()


@contextlib.contextmanager
def soon(_needed: object) -> Iterator[threading.Event]:
    yield Soon()


def transport_to_the_bench() -> Transport:
    """To the bench, with nothing beside it."""
    return Transport(DirectBus(BenchEndpoint()), 1_000_000, lambda: 0, lambda: None)


@pytest.fixture
def deployment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """An arm whose board is on a transport that leads to the bench."""
    monkeypatch.setattr("qrobot.hwif.transports.open_transport", lambda *_: transport_to_the_bench())
    monkeypatch.setattr("qrobot.hwif.gateway.set_on_signals", soon)
    path = tmp_path / "here.toml"
    arm = f'[[arm]]\nname = "record{os.getpid()}"\nrobot = "puma560"\nbridge = {{ port = 5600 }}\n'
    path.write_text(arm + "servo = { board_timeout_ms = 10 }\nboard = { kind = 'can', can = {} }\n")
    return str(path)


def test_a_gateway_writes_down_what_it_did_and_replay_tells_it(
    deployment: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "registers.txt"
    board(deployment, record=file)
    capsys.readouterr()
    assert run_app(make_app(), ["board", "replay", str(file), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["boards"], facts["connections"]) == (["revision F, 6 joints"], 1)
    assert facts["exchanges"] >= 3
    assert (facts["failed"], facts["torn"]) == (0, False)
    found_and_left = 2  # the board is made safe at both ends
    assert facts["accesses"]["DISCRETE"] == found_and_left
    assert facts["accesses"][f"DAC {N_DACS}"] == found_and_left
    assert run_app(make_app(), ["board", "replay", str(file)]) == 0
    assert "revision F" in capsys.readouterr().out


def test_without_recording_nothing_is_written(deployment: str, tmp_path: Path) -> None:
    board(deployment)
    assert [path.name for path in tmp_path.iterdir()] == ["here.toml"]


@pytest.mark.parametrize("text", ["", "hello\n", "qrobot-registers 1\nboard F\n"])
def test_a_file_that_is_no_recording_is_one_line(text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "x"
    file.write_text(text)
    assert run_app(make_app(), ["board", "replay", str(file)]) == 1
    assert str(file) in capsys.readouterr().err.replace("\n", "")


def test_an_emulated_board_is_not_recorded_at_its_registers(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_app(make_app(), ["board", "emulator", "--record", "x"]) == 1
    assert "behind no transport" in capsys.readouterr().err


def test_a_place_that_cannot_be_written_ends_it_before_it_starts(
    deployment: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_app(make_app(), ["board", deployment, "--record", str(tmp_path / "no" / "where")]) == 1
    assert "cannot record" in capsys.readouterr().err


def test_a_recording_is_not_written_over(deployment: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What a board did does not come again, and a command is repeated from the history of a shell."""
    file = tmp_path / "registers.txt"
    file.write_text("what went over the wire when it failed\n")
    assert run_app(make_app(), ["board", deployment, "--record", str(file)]) == 2
    assert "there is a file of that name with something in it, name another" in " ".join(
        capsys.readouterr().err.split()
    )
    assert file.read_text() == "what went over the wire when it failed\n"
