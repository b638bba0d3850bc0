"""The end of the process that moves an arm, when the pendant ends."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from qrobot.config.deployment import DeployedArm
from qrobot.pendant import jog_worker
from qrobot.pendant.jog_worker import JogWorker
from tests.support.patience import wait_until

pytestmark = pytest.mark.realtime

TELLS = 'print(\'{"session": "no", "text": "", "guide": false, "led": [], "writes": %s}\', flush=True)'
AT_THE_END = "import sys; sys.stdin.read(); "

ARM = DeployedArm.model_validate({"name": "one", "robot": "puma560", "bridge": {"port": 5600}})

StartWorker = Callable[[str], JogWorker]


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> StartWorker:
    """Starts a worker whose process is this program, and hears its first line."""

    def start(program: str) -> JogWorker:
        monkeypatch.setattr(jog_worker, "own_command", lambda *_: [sys.executable, "-c", program])
        told: list[str] = []
        worker = JogWorker(ARM, Path("unused"), told.append)
        worker.start()
        wait_until(lambda: told, "its first line")
        return worker

    return start


def test_a_recording_that_is_being_written_is_written_to_its_end(started: StartWorker, tmp_path: Path) -> None:
    file = tmp_path / "led.csv"
    worker = started(f"{TELLS % 'true'}; {AT_THE_END}open({str(file)!r}, 'w').write('led')")
    worker.close()
    worker.wait(0.0)
    assert file.read_text() == "led"


def test_a_process_that_writes_nothing_and_does_not_end_is_killed(started: StartWorker) -> None:
    worker = started(f"{TELLS % 'false'}; {AT_THE_END}import threading; threading.Event().wait()")
    worker.close()
    worker.wait(0.0)
    assert worker._process is not None
    assert worker._process.returncode < 0
