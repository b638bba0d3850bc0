"""An arm that is taken at the pendant, and taken back again by a STOP before it follows: it stays without power."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from qrobot.config import load_robot
from qrobot.modecodes import Mode
from qrobot.pendant.guide_session import GuideSession
from qrobot.pendant.held_press import Press
from qrobot.pendant.jog_session import JogSession
from qrobot.rccl.guiding import GUIDE_PERIOD_US
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.calibration.table import load_table
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.wire import Command, Hello, State

ROBOT = load_robot("puma560")
MOST_SAMPLES = 150  # a session that has not ended by then is ended by the test

Session = JogSession | GuideSession


class Desk:
    """A page that takes an arm, and somebody whose STOP its session hears at the sample of that number."""

    def __init__(
        self, make: Callable[[Any, list[str]], Session], stop_at: int, press_at: int = 0, power: bool = False
    ) -> None:
        self.rig = LockstepRig(ROBOT, ServoSettings(calibration=load_table("puma560", ROBOT)), Emulator(ROBOT))
        self.rig.run_for(0.3)
        self.rig.mailbox.request_power(power)
        self.rig.run_for(0.3)
        self.modes: list[int] = []
        self._stop_at, self._press_at = stop_at, press_at
        self.said: list[str] = []
        self.session = make(self._open, self.said)
        self.session.run()
        self.rig.run_for(1.0)

    @property
    def mode(self) -> Mode:
        return Mode(self.rig.mailbox.snapshot().mode)

    def sampled(self, state: State) -> None:
        self.modes.append(state.robot.mode)
        number = len(self.modes)
        if self._press_at and self._press_at <= number:
            self.session.press.begin(Press(number, "guide", "hand"), 0.0)
        if number == self._stop_at:
            self.session.leave()
        if number == MOST_SAMPLES:
            self.session.leave()

    def _open(self, hello: Hello) -> Any:
        return _Watched(self, link_factory(self.rig, GUIDE_PERIOD_US, hello))


class _Watched:
    def __init__(self, desk: Desk, link: Any) -> None:
        self._desk, self._link = desk, link

    def __getattr__(self, name: str) -> Any:
        return getattr(self._link, name)

    def exchange(self, command: Command | None) -> State:
        state: State = self._link.exchange(command)
        self._desk.sampled(state)
        return state


def jog(taught: Path) -> Callable[[Any, list[str]], Session]:
    def make(link: Any, said: list[str]) -> Session:
        return JogSession("puma560", link, taught, lambda: said.append("ready"), said.append, lambda: 0.0)

    return make


def lead(link: Any, said: list[str]) -> Session:
    return GuideSession("puma560", link, lambda: said.append("ready"), said.append, lambda: 0.0)


def test_a_stop_before_the_arm_has_power_ends_the_session_that_was_about_to_power_it(tmp_path: Path) -> None:
    taken = Desk(jog(tmp_path / "t.db"), MOST_SAMPLES)
    assert taken.mode is Mode.HOLDING  # taking an arm powers it
    until_power = next(k for k, mode in enumerate(taken.modes) if mode not in (Mode.OFF, Mode.POWERING))
    for stop_at in range(1, until_power + 2):  # power that came in the very sample of the STOP goes as well
        desk = Desk(jog(tmp_path / "t.db"), stop_at)
        assert desk.mode is Mode.OFF, stop_at
        assert "ready" not in desk.said
        assert len(desk.modes) <= stop_at + 1


@pytest.mark.parametrize("stop_at", [1, 2, 3, 4, 5, 100])
def test_an_arm_that_had_power_before_holds_whenever_the_stop_comes(stop_at: int, tmp_path: Path) -> None:
    for make in (jog(tmp_path / "t.db"), lead):
        desk = Desk(make, stop_at, power=True)
        assert desk.mode is Mode.HOLDING
        assert len(desk.modes) < MOST_SAMPLES


def test_a_button_to_lead_the_arm_powers_it_and_a_stop_takes_that_back() -> None:
    taken = Desk(lead, MOST_SAMPLES, press_at=4)
    assert taken.mode is Mode.HOLDING
    until_power = next(k for k, mode in enumerate(taken.modes) if mode not in (Mode.OFF, Mode.POWERING))
    for stop_at in range(4, until_power + 2):
        desk = Desk(lead, stop_at, press_at=4)
        assert desk.mode is Mode.OFF, stop_at
