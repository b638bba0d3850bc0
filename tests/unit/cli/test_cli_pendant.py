"""`qrobot pendant`: what it does beside its pages, with a server that only pretends."""

from __future__ import annotations

import logging
import socket
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.config.deployment import DeployedArm
from qrobot.log.record import write_log
from qrobot.pendant import server
from tests.support.log_samples import make_header, make_rows
from tests.support.patience import PATIENCE_S, wait_until
from tests.support.processes import write_deployment


def test_what_goes_wrong_is_told_without_waiting_for_a_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """STOP of its pages rests on the thread in which it does."""
    done: list[str] = []
    told: list[str] = []
    let_go = threading.Event()

    def note(line: str) -> None:
        assert let_go.wait(PATIENCE_S)
        told.append(line)

    class Pretence:
        def __init__(self, _config: object, began: Callable[[], None]) -> None:
            self._began = began

        async def serve(self, sockets: list[socket.socket]) -> None:
            sockets[0].close()
            self._began()
            logging.getLogger("qrobot.pendant.arm_watch").error("the watch failed")
            try:
                raise RuntimeError("no room")
            except RuntimeError:
                logging.getLogger("uvicorn.error").exception("Exception in ASGI application\n")
            assert not let_go.is_set()
            done.append("pages")
            let_go.set()
            wait_until(lambda: len(told) == 3, "the lines")

    monkeypatch.setattr(logging.getLogger(), "handlers", [])
    monkeypatch.setattr("qrobot.cli.pendant.note", note)
    monkeypatch.setattr(server, "PendantServer", Pretence)
    deployment = str(write_deployment(tmp_path))
    taught = str(tmp_path / "t.db")
    assert run_app(make_app("pendant"), ["pendant", "--deployment", deployment, "--port", "0", "--taught", taught]) == 0
    assert done == ["pages"]
    assert told[1:] == ["the watch failed", "pendant: RuntimeError: no room"]


def test_only_who_drives_an_arm_needs_a_file_of_places(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A log may be looked at where nothing can be written."""
    log, deployment = write_log(tmp_path / "run.mcap", make_rows(3), make_header())[0], str(write_deployment(tmp_path))
    monkeypatch.chdir("/proc")
    monkeypatch.setattr("qrobot.pendant.server.serve", lambda _app, listener, _began: listener.close())
    assert run_app(make_app("pendant"), ["pendant", "--log", str(log), "--port", "0"]) == 0
    assert run_app(make_app("pendant"), ["pendant", "--deployment", deployment, "--port", "0"]) == 1
    assert "cannot write taught.db" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("words", "files"),
    [
        ([], {"left": "cell-left.db", "right": "cell-right.db"}),
        (["--arm", "right"], {"right": "cell-right.db"}),  # the same file as beside the other one
    ],
)
def test_arms_of_one_deployment_have_their_own_files_of_places(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], files: dict[str, str]
) -> None:
    found: dict[str, Path] = {}

    def add(_floor: object, arm: DeployedArm, taught: Path, _programs: object) -> None:
        found[arm.name] = taught

    monkeypatch.setattr("qrobot.cli.pendant._add_station", add)
    monkeypatch.setattr("qrobot.pendant.server.serve", lambda _app, listener, _began: listener.close())
    taught = str(tmp_path / "cell.db")
    command = ["pendant", "--deployment", "two_arms", "--port", "0", "--taught", taught, *words]
    assert run_app(make_app("pendant"), command) == 0
    assert found == {arm: tmp_path / file for arm, file in files.items()}
