"""What an arm was led through is written while the process that moves it goes on reading, over no other file."""

from __future__ import annotations

import io
import threading
from pathlib import Path

import numpy as np
import pytest

from qrobot.config import Robot
from qrobot.errors import ConfigError
from qrobot.pendant import recording_writer
from qrobot.pendant.free_path import write_beside
from qrobot.pendant.jog_process import WRITES, JogProcess
from qrobot.rccl.setpoints import Setpoints
from tests.support.patience import PATIENCE_S

LINES = [
    '{"do": "on", "guide": false, "back": 0.0}',
    '{"do": "press", "number": 1, "target": "joint", "name": "1"}',
    '{"do": "beat", "number": 1}',
    '{"do": "release"}',
    '{"do": "hand", "opened": true}',
    '{"do": "load", "mass": 1.0, "centre": [0.0, 0.0, 0.0]}',
    '{"do": "stop", "power_off": true}',
    '{"do": "off"}',
    '{"do": "forget"}',
]


@pytest.fixture
def led() -> Setpoints:
    """One press: half a second of the waist."""
    q = np.zeros((20, 6))
    q[:, 0] = np.linspace(0.0, 0.01, 20)
    return Setpoints("puma560", 28_000, q)


def test_every_line_is_obeyed_while_a_recording_is_smoothed_and_the_arm_is_not_taken_later(
    led: Setpoints, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, may_go_on, answers = threading.Event(), threading.Event(), io.StringIO()

    def smooth(motion: Setpoints, _robot: Robot, _tolerance_m: float) -> Setpoints:
        begun.set()
        assert may_go_on.wait(PATIENCE_S)
        return motion

    monkeypatch.setattr(recording_writer, "smoothed", smooth)
    process = JogProcess("puma560", pytest.fail, tmp_path / "t.db", answers, lambda: 0.0)
    process._led = [led]
    keep = f'{{"do": "keep", "folder": "{tmp_path}", "name": "left-led", "smooth": 0.003}}'
    reader = threading.Thread(target=process.read, args=([keep, keep, *LINES],))
    reader.start()
    reader.join(PATIENCE_S)
    obeyed, told = not reader.is_alive(), answers.getvalue()
    assert begun.wait(PATIENCE_S)
    may_go_on.set()
    process.run()
    assert obeyed
    assert WRITES in told
    assert '"led": []' in told.splitlines()[-1]
    assert '"writes": true' in told.splitlines()[-1]
    assert "opening" not in answers.getvalue()
    assert '"writes": false' in answers.getvalue().splitlines()[-1]
    for name in ("left-led.csv", "left-led-1.csv"):  # both that were asked for
        assert (tmp_path / name).stat().st_size
        assert f"wrote {tmp_path / name}" in answers.getvalue()


def test_a_recording_that_cannot_be_written_for_whatever_reason_is_told(
    led: Setpoints, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError

    told: list[str] = []
    monkeypatch.setattr(recording_writer, "smoothed", fail)
    writer = recording_writer.RecordingWriter("puma560", told.append)
    writer.write([led], tmp_path, "left-led", 0.003)
    writer.close()
    assert told == ["the recording is not written: ZeroDivisionError"]
    assert not writer.writes


def test_a_file_that_comes_meanwhile_is_not_written_over(tmp_path: Path) -> None:
    folder = tmp_path / "new"

    def write(path: Path) -> None:
        write_beside(folder, "model", ".toml", lambda other: other.write_text("theirs"))
        path.write_text("ours")

    assert write_beside(folder, "model", ".toml", write) == folder / "model.toml"
    assert (folder / "model.toml").read_text() == "ours"
    assert (folder / "model-1.toml").read_text() == "theirs"


def test_a_file_that_could_not_be_written_does_not_stay(tmp_path: Path) -> None:
    def fail(_path: Path) -> None:
        raise ConfigError("the disk is full")

    with pytest.raises(ConfigError, match="the disk is full"):
        write_beside(tmp_path, "model", ".toml", fail)
    assert not list(tmp_path.iterdir())
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match="cannot write into"):
        write_beside(tmp_path / "file", "model", ".toml", fail)
