"""`qrobot guide` in lock-step: what was led is on the disk, whatever ends the command."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest

from qrobot.cli.console import FAILURE, INTERRUPTED, SUCCESS, run_app
from qrobot.cli.main import make_app
from qrobot.config import load_robot
from qrobot.errors import LinkLost, MotionError
from qrobot.hwif.board_memory import PANEL_MICRO
from qrobot.rccl.guiding import GUIDE_PERIOD_US
from qrobot.rccl.led_by_key import LEAD
from qrobot.rccl.setpoint_tables import read_setpoint_table
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.calibration.table import load_table
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.wire import Hello
from tests.support.signals import default_signals

ROBOT: Final = load_robot("puma560")
BENT: Final = np.array(ROBOT.poses["ready"]) + np.array([0.3, 0.2, 0.4, 0.3, 0.7, 0.1])
GENTLY: Final = np.array([32.0, 22.0, 12.0, 1.5, 1.5, 1.5])  # N m
POWERED: Final = 32  # samples of the key, until it has power and is led
ONE_PRESS: Final = ("", "", *[LEAD] * 80, *[""] * 30)
WHILE_LED: Final = ONE_PRESS[:75]
MOVED: Final = 0.05  # rad, of the waist, by one press

Key = str | Callable[[], object]


class Desk:
    """An emulated arm that somebody pushes, keys that are typed, and the command."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *keys: Key, lost_at: int = 0) -> None:
        settings = ServoSettings(rate_hz=1000, calibration=load_table("puma560", ROBOT))
        self.rig = LockstepRig(ROBOT, settings, Emulator(ROBOT, start=BENT, physics="rigid"))
        self.rig.run_for(0.3)
        self.taken, self._keys, self._held, self._lost_at = False, iter(keys), 0, lost_at
        monkeypatch.setattr("qrobot.cli.arm_links.link_of", lambda _arm: self._link)
        monkeypatch.setattr("qrobot.cli.guide.single_keys", self._typed)

    def guide(self, *words: str | Path) -> int:
        return run_app(make_app("guide"), ["guide", *map(str, words)])

    def read(self) -> str:
        key = next(self._keys)
        self._held = self._held + 1 if key == LEAD else 0
        self._push(GENTLY if self._held > POWERED else 0.0 * GENTLY)
        if isinstance(key, str):
            return key
        key()
        return ""

    def _push(self, tau: np.ndarray) -> None:
        self.rig.board.panel.push[: ROBOT.n] = np.round(tau * PANEL_MICRO).astype(np.int64)

    @contextmanager
    def _typed(self, _command: str) -> Iterator[Desk]:
        yield self

    def _link(self, hello: Hello) -> Any:
        self.taken = True
        return _Losable(link_factory(self.rig, GUIDE_PERIOD_US, hello), self._lost_at)


class _Losable:
    """A link that is lost at a sample; 0 for never."""

    def __init__(self, link: Any, lost_at: int) -> None:
        self._link, self._lost_at, self._sample = link, lost_at, 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._link, name)

    def exchange(self, command: Any) -> Any:
        self._sample += 1
        if self._lost_at and self._sample >= self._lost_at:
            raise LinkLost("the bridge is gone")
        return self._link.exchange(command)


def waist_turns(path: Path) -> float:
    """How far the waist turned in a recording, rad."""
    return float(np.ptp(read_setpoint_table(path, ROBOT).q[:, 0]))


def interrupt() -> None:
    raise KeyboardInterrupt


def break_the_pipe() -> None:
    raise OSError(5, "Input/output error")


@pytest.mark.parametrize(
    ("keys", "end", "status"),
    [
        (ONE_PRESS, "q", SUCCESS),
        (ONE_PRESS, interrupt, INTERRUPTED),
        (WHILE_LED, interrupt, INTERRUPTED),
        (WHILE_LED, partial(signal.raise_signal, signal.SIGTERM), INTERRUPTED),
        (WHILE_LED, partial(signal.raise_signal, signal.SIGHUP), INTERRUPTED),
    ],
    ids=["q", "Ctrl-C at rest", "Ctrl-C", "SIGTERM", "SIGHUP"],
)
def test_what_was_led_is_written_whatever_ends_the_command(
    keys: tuple[Key, ...], end: Key, status: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "new folder" / "lesson.csv"
    with default_signals(signal.SIGTERM, signal.SIGHUP):
        assert Desk(monkeypatch, *keys, end).guide(path) == status
    assert waist_turns(path) > MOVED


def test_what_was_led_is_written_when_the_terminal_is_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(OSError, match="Input/output"):
        Desk(monkeypatch, *WHILE_LED, break_the_pipe).guide(tmp_path / "lesson.csv")
    assert waist_turns(tmp_path / "lesson.csv") > MOVED


@pytest.mark.parametrize("lost_at", [75, 110])
def test_what_was_led_until_the_link_was_lost_is_written(
    lost_at: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    desk = Desk(monkeypatch, *ONE_PRESS, lost_at=lost_at)
    assert desk.guide(tmp_path / "lesson.csv") == FAILURE
    assert waist_turns(tmp_path / "lesson.csv") > MOVED
    assert capsys.readouterr().err.splitlines()[-1] == "qrobot: the bridge is gone"


@pytest.mark.parametrize(("end", "status"), [("q", FAILURE), (interrupt, INTERRUPTED)])
def test_a_recording_that_cannot_be_smoothed_is_written_as_it_was_led(
    end: Key, status: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(*_: object) -> None:
        raise MotionError("the recording trembles too much for 3 mm: allow more, or lead the arm anew")

    monkeypatch.setattr("qrobot.rccl.recordings.smoothed", refuse)
    path = tmp_path / "lesson.csv"
    assert Desk(monkeypatch, *ONE_PRESS, end).guide(path, "--smooth", "3") == status
    assert waist_turns(path) > MOVED
    said = " ".join(capsys.readouterr().err.split())
    assert "trembles too much" in said
    assert f"`qrobot replay {path} --smooth MM --save-as FILE`" in said


def test_a_recording_is_smoothed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, words in (("led.csv", ()), ("smooth.csv", ("--smooth", "3"))):
        assert Desk(monkeypatch, *ONE_PRESS, "q").guide(tmp_path / name, *words) == SUCCESS
    led, smooth = (read_setpoint_table(tmp_path / name, ROBOT).q for name in ("led.csv", "smooth.csv"))
    assert np.abs(np.diff(smooth, 2, axis=0)).max() < np.abs(np.diff(led, 2, axis=0)).max()


def test_a_data_base_that_cannot_be_read_is_told_before_the_arm_is_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "places.db").write_text("P1 not six numbers\n")
    desk = Desk(monkeypatch, *ONE_PRESS, "q")
    assert desk.guide(tmp_path / "lesson.csv", "--places", tmp_path / "places.db") == FAILURE
    assert not desk.taken
    assert "places.db, line 1" in capsys.readouterr().err


def test_a_place_that_cannot_be_kept_is_told_and_the_arm_is_led_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    places = tmp_path / "places.db"
    damage = partial(places.write_text, "P1 not six numbers\n")
    keys = (damage, "w", *[""] * 40, places.unlink, "w", *[""] * 15, *ONE_PRESS, "q")
    assert Desk(monkeypatch, *keys).guide(tmp_path / "lesson.csv", "--places", places) == SUCCESS
    said = [line.partition(":")[0] for line in capsys.readouterr().out.splitlines()]
    assert [line for line in said if line in ("error", "kept P1", "led by hand")] == ["error", "kept P1", "led by hand"]
    assert waist_turns(tmp_path / "lesson.csv") > MOVED
