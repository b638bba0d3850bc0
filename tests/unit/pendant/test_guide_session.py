"""An arm that is led from the pendant, in lock-step: presses of a page and pushes of a hand at given instants."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.hwif.board_memory import PANEL_MICRO
from qrobot.modecodes import Mode
from qrobot.model.arm import Arm
from qrobot.pendant.guide_session import GuideSession
from qrobot.pendant.held_press import PATIENCE_S, Press
from qrobot.pendant.jog_process import JogProcess
from qrobot.rccl.guiding import GUIDE_PERIOD_US
from qrobot.rccl.recordings import deviation
from qrobot.rccl.setpoint_tables import read_setpoint_table
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.calibration.table import load_table
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.wire import Command, Hello, State

ROBOT = load_robot("puma560")
BENT = np.array(ROBOT.poses["ready"]) + np.array([0.3, 0.2, 0.4, 0.3, 0.7, 0.1])
GENTLY = np.array([32.0, 22.0, 12.0, 1.5, 1.5, 1.5])  # N m
SAMPLE_S = GUIDE_PERIOD_US * 1e-6

Deed = tuple[float, Callable[["Page"], object]]


class Page:
    """A page with a button, somebody who pushes the arm, and what becomes of it sample by sample."""

    def __init__(self, *deeds: Deed) -> None:
        emulator = Emulator(ROBOT, start=BENT, physics="rigid")
        settings = ServoSettings(rate_hz=1000, calibration=load_table("puma560", ROBOT))
        self.rig = LockstepRig(ROBOT, settings, emulator)
        self.rig.run_for(0.3)
        self.held = 0  # number of the press that the page says is held
        self.said: list[str] = []
        self.q: list[np.ndarray] = []
        self._deeds = sorted(deeds, key=lambda deed: deed[0])
        self.session = GuideSession("puma560", self._open, lambda: None, self.said.append, self.now_s)
        self.session.run()

    def now_s(self) -> float:
        return len(self.q) * SAMPLE_S

    def press(self, number: int, target: Any = "guide") -> None:
        self.session.press.begin(Press(number, target, "hand"), self.now_s())
        self.held = number

    def push(self, tau: np.ndarray) -> None:
        self.rig.board.panel.push[: ROBOT.n] = np.round(tau * PANEL_MICRO).astype(np.int64)

    def at(self, seconds: float) -> np.ndarray:
        return self.q[round(seconds / SAMPLE_S)]

    def sampled(self) -> None:
        self.q.append(self.rig.emulator.q.copy())
        while self._deeds and self._deeds[0][0] <= self.now_s():
            self._deeds.pop(0)[1](self)
        if self.held:
            self.session.press.beat(self.held, self.now_s())

    def _open(self, hello: Hello) -> Any:
        return _Watched(self, link_factory(self.rig, GUIDE_PERIOD_US, hello))


class _Watched:
    def __init__(self, page: Page, link: Any) -> None:
        self._page, self._link = page, link

    def __getattr__(self, name: str) -> Any:
        return getattr(self._link, name)

    def exchange(self, command: Command | None) -> State:
        state: State = self._link.exchange(command)
        self._page.sampled()
        return state


def press(number: int, target: Any = "guide") -> Callable[[Page], object]:
    return lambda page: page.press(number, target)


def silence(page: Page) -> None:
    page.held = 0


def test_an_arm_is_led_while_its_button_is_held_and_a_page_that_fell_silent_leads_it_only_with_another_press(
    tmp_path: Path,
) -> None:
    page = Page(
        (0.2, press(1)),
        (1.2, lambda page: page.push(GENTLY)),
        (1.9, silence),
        (2.8, lambda page: setattr(page, "held", 1)),  # it is back, with its button down
        (3.3, lambda page: page.session.press.end()),
        (3.4, press(2)),
        (4.2, lambda page: page.push(0.0 * GENTLY)),
        (4.5, press(3, "joint")),
        (5.0, lambda page: page.session.leave()),
    )
    rest_s = 1.9 + PATIENCE_S + 0.4
    assert np.abs(page.at(1.15) - page.at(0.9)).max() < 1e-3  # it carries its weight
    assert (page.at(1.9) - page.at(1.2))[1:].min() > 0.03
    np.testing.assert_allclose(page.at(3.3), page.at(rest_s), atol=0.02)  # the push goes on, and the arm is held
    assert (page.at(4.2) - page.at(3.4))[1:].min() > 0.02
    assert page.now_s() < 6.0  # a stop ends the session
    assert Mode(page.rig.mailbox.snapshot().mode) is Mode.HOLDING
    assert len(page.session.recordings) == 2
    first, second = page.session.recordings
    np.testing.assert_allclose(first.q[-1], second.q[0], atol=0.02)
    silent, refused = page.said
    assert "nothing was heard of the page" in silent
    assert "let go of it" in refused  # the button of the joint

    answers, path = io.StringIO(), tmp_path / "one-led.csv"
    process = JogProcess("puma560", pytest.fail, tmp_path / "t.db", answers, page.now_s)
    nothing = JogProcess("puma560", pytest.fail, tmp_path / "t.db", answers, page.now_s)
    read(nothing, [keep(tmp_path, 0.003), keep(tmp_path, 0.0)])
    assert answers.getvalue().count("is not written: there is nothing") == 2
    process._led = page.session.recordings
    (tmp_path / "file").touch()
    read(process, [keep(tmp_path, 0.003), keep(tmp_path / "file", 0.0), '{"do": "forget"}'])
    written = read_setpoint_table(path, ROBOT)
    np.testing.assert_allclose(written.q[[0, -1]], [first.q[0], second.q[-1]], atol=1e-6)
    told = answers.getvalue()
    assert "qrobot replay" in told
    assert f"is not written: cannot write into {tmp_path / 'file'}" in told
    assert '"led": []' in told.splitlines()[-1]
    assert deviation(written.q[:1], first.q[:1], Arm(ROBOT)) < 1e-6


def keep(folder: Path, smooth: float) -> str:
    return f'{{"do": "keep", "folder": "{folder}", "name": "one-led", "smooth": {smooth}}}'


def read(process: JogProcess, lines: list[str]) -> None:
    """Let a process obey lines, and end."""
    process.read(lines)
    process.run()
