"""A gamepad that moves an arm: synthetic events of Linux input, by themselves and to an arm in lock-step."""

from __future__ import annotations

import errno
from collections.abc import Iterable
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from qrobot import rccl
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.cli.stick_device import BTN_0, BTN_SOUTH, BTN_TL, EV_ABS, EV_KEY, EV_REL, RY, StickDevice, X, Y, open_stick
from qrobot.errors import ConfigError, LinkError
from qrobot.faultcodes import FaultCode
from qrobot.rccl.held_motion import AXIS_MM_S, BRAKE_MS
from qrobot.rccl.held_stick import DROPPED, REST_MS, SILENCE_MS, SYN, HeldStick, StickEvent, StickJog
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.puma import ROBOT
from tests.support.puma import arm as puma

PERIOD_MS = 28.0
FULL = 32767


def gamepad(code: int) -> tuple[int, SimpleNamespace]:
    return code, SimpleNamespace(min=-FULL - 1, max=FULL, value=0)


class FakeDevice:
    """A gamepad whose events come when they are told; answers as an `evdev.InputDevice`."""

    def __init__(self, name: str = "pad", buttons: tuple[int, ...] = (BTN_SOUTH, BTN_TL, 0x137)) -> None:
        self.name, self.lost = name, False
        self.waiting: list[SimpleNamespace] = []
        self.now: dict[int, int] = {}
        self._capabilities = {EV_KEY: list(buttons), EV_ABS: [gamepad(code) for code in (X, Y, 3, RY)]}

    def capabilities(self, absinfo: bool) -> dict[int, list[object]]:
        assert absinfo
        return self._capabilities

    def read(self) -> Iterable[SimpleNamespace]:
        if self.lost:
            raise OSError(errno.ENODEV, "No such device")
        if not self.waiting:
            raise BlockingIOError
        came, self.waiting = self.waiting, []
        return came

    def absinfo(self, code: int) -> SimpleNamespace:
        return SimpleNamespace(value=self.now.get(code, 0))

    def tell(self, kind: int, code: int, value: int) -> None:
        self.waiting.append(SimpleNamespace(type=kind, code=code, value=value))


PUSHED, LET_GO = StickEvent(EV_KEY, BTN_TL, 1), StickEvent(EV_KEY, BTN_TL, 0)
AWAY, BACK = StickEvent(EV_ABS, Y, -FULL), StickEvent(EV_ABS, Y, 0)
LEFT = StickEvent(EV_ABS, X, -FULL)


def heard(*steps: tuple[float, list[StickEvent]]) -> list[tuple[str, float] | None]:
    stick = HeldStick(StickDevice(FakeDevice()).layout)
    return [stick.hear(events, t_ms) for t_ms, events in steps]


def test_a_stick_counts_only_while_the_button_is_held_that_was_pressed_with_all_sticks_at_rest() -> None:
    assert heard((0, [AWAY]), (10, [PUSHED]), (20, [BACK, AWAY])) == [None, None, None]
    assert heard((0, [PUSHED]), (10, [AWAY]), (20, [LET_GO]), (30, [AWAY]), (40, [PUSHED])) == [
        None, ("dx", 1.0), None, None, None,
    ]  # fmt: skip


def test_one_stick_moves_the_arm_at_a_time_until_it_has_gone_back() -> None:
    half = StickEvent(EV_ABS, Y, -FULL // 2)
    assert heard((0, [PUSHED]), (10, [half]), (20, [LEFT]), (30, [BACK]), (40, [StickEvent(EV_ABS, X, FULL)])) == [
        None, ("dx", 1.0), ("dx", 1.0), ("dy", 1.0), ("dy", -1.0),
    ]  # fmt: skip


def test_a_device_that_falls_silent_while_it_moves_the_arm_is_let_go_of_until_the_button_is_pressed_anew() -> None:
    late = 10 + SILENCE_MS + 1
    assert heard((0, [PUSHED]), (10, [AWAY]), (late - 2, []), (late, []), (late + 10, [AWAY]), (late + 20, [BACK])) == [
        None, ("dx", 1.0), ("dx", 1.0), None, None, None,
    ]  # fmt: skip
    assert heard((0, [PUSHED]), (9e3, []), (9.01e3, [AWAY])) == [None, None, ("dx", 1.0)]  # a button alone may rest


def test_after_events_were_lost_the_button_has_to_be_pressed_anew() -> None:
    lost = StickEvent(SYN, DROPPED, 0)
    assert heard((0, [PUSHED]), (10, [AWAY]), (20, [lost]), (30, [AWAY]), (40, [BACK, PUSHED]), (50, [AWAY])) == [
        None, ("dx", 1.0), None, None, None, ("dx", 1.0),
    ]  # fmt: skip


def test_after_events_were_lost_a_stick_is_where_it_is() -> None:
    device = FakeDevice()
    stick, held = HeldStick((found := StickDevice(device)).layout), []
    for drawn in (-FULL, 0):
        device.now[X] = drawn
        device.tell(SYN, DROPPED, 0)
        held.append(stick.hear(found.read(), 10.0))
        device.tell(EV_KEY, BTN_TL, 1)
        device.tell(EV_ABS, Y, -FULL)
        held.append(stick.hear(found.read(), 20.0))
        device.tell(EV_ABS, Y, 0)
        held.append(stick.hear(found.read(), 30.0))
    assert held == [None, None, None, None, ("dx", 1.0), None]


def test_a_frame_is_for_keys_and_refused_with_a_stick(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_app(make_app(), ["jog", "--offline", "--stick", "/dev/null", "--frame", "parts.db:TABLE"]) == 1
    assert "--frame does not go with --stick" in capsys.readouterr().err


def test_a_stick_that_is_drawn_when_the_device_is_opened_is_not_at_rest() -> None:
    device = FakeDevice()
    device.capabilities(True)[EV_ABS][0] = X, SimpleNamespace(min=-FULL - 1, max=FULL, value=-FULL)
    stick = HeldStick(StickDevice(device).layout)
    for events in ([PUSHED], [AWAY], [StickEvent(EV_ABS, X, 0), BACK]):
        assert stick.hear(events, 10.0) is None
    assert stick.hear([LET_GO, PUSHED, AWAY], 20.0) == ("dx", 1.0)


def test_speed_grows_with_the_stroke() -> None:
    stick = HeldStick(StickDevice(FakeDevice()).layout)
    stick.hear([PUSHED], 0.0)
    speeds = []
    for share in (0.3, 0.5, 0.8, 1.0):
        stick.hear([StickEvent(EV_ABS, RY, round(share * FULL))], 10.0)
        speeds.append(stick.speed)
    assert speeds == sorted(set(speeds))
    assert (speeds[0] <= 0.2, speeds[-1]) == (True, 1.0)


def test_a_space_mouse_is_known_and_other_devices_are_refused() -> None:
    mouse = SimpleNamespace(
        name="SpaceMouse", capabilities=lambda absinfo: absinfo and {EV_KEY: [BTN_0], EV_REL: list(range(6))}
    )
    stick = HeldStick(StickDevice(mouse).layout)
    assert stick.hear([StickEvent(EV_KEY, BTN_0, 1), StickEvent(EV_REL, 2, 300)], 0.0) == ("dz", -1.0)
    assert stick.hear([], REST_MS) == ("dz", -1.0)
    assert stick.hear([], REST_MS + 1) is None  # Linux tells of no relative axis that it is back at rest
    assert stick.hear([StickEvent(EV_REL, 2, 200)], 300.0) == ("dz", -1.0)
    assert stick.hear([StickEvent(EV_REL, Y, -200)], 380.0) == ("dz", -1.0)  # one at a time
    assert stick.hear([StickEvent(EV_REL, Y, -200)], 460.0) == ("dx", 1.0)  # though something is pushed all the time
    with pytest.raises(ConfigError, match="keyboard is neither a gamepad"):
        StickDevice(FakeDevice("keyboard", buttons=(30, 31)))


@pytest.mark.skipif(not find_spec("evdev"), reason='no python-evdev: .venv/bin/pip install "evdev>=1.9"')
def test_a_device_that_is_not_there_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"cannot open .*nowhere"):
        open_stick(Path("/dev/nowhere"))


class Desk:
    """An arm in lock-step at its start pose, and somebody at a gamepad."""

    def __init__(self, *script: tuple[float, StickEvent | str]) -> None:
        self.rig = LockstepRig(ROBOT, ServoSettings(rate_hz=500.0), Emulator(ROBOT, physics="rigid"))
        self.device, self.said = FakeDevice(), list[str]()
        self._script = sorted(script, key=lambda entry: entry[0])

    def jog(self, until_ms: float) -> Desk:
        with rccl.use(partial(link_factory, self.rig, round(PERIOD_MS * 1e3))), rccl.control() as arm:
            device = StickDevice(self.device)

            def read() -> Iterable[StickEvent]:
                while self._script and self._script[0][0] <= arm.time:
                    self._do(self._script.pop(0)[1])
                return device.read()

            StickJog(arm, device.layout, read, self.said.append, over=lambda: arm.time > until_ms).run()
        return self

    def _do(self, what: StickEvent | str) -> None:
        if isinstance(what, StickEvent):
            self.device.tell(*what)
        elif what == "lost":
            self.device.lost = True
        else:
            self.rig.mailbox.request_override(0.5)

    @property
    def moving_ms(self) -> tuple[float, float]:
        """When the reference began and ceased to move."""
        rows = self.rig.rows()
        t_ms = (rows["t_ns"] - rows["t_ns"][0]) * 1e-6
        moves = np.flatnonzero(np.abs(rows["v_ref"]).max(axis=1) > 1e-6)
        return float(t_ms[moves[0]]), float(t_ms[moves[-1]])


HALF = StickEvent(EV_ABS, Y, -round(0.575 * FULL))


@pytest.mark.parametrize(
    "slower", [[(2000.0, HALF)], [(1500.0, AWAY), (2000.0, "operator's override"), (2500.0, AWAY)]], ids=["stick", "op"]
)
def test_an_arm_goes_along_the_axis_as_fast_as_it_may_and_rests_when_the_stick_goes_back(
    slower: list[tuple[float, StickEvent | str]],
) -> None:
    """That is as far as the stick is drawn, and as fast as the operator's override lets it be."""
    desk = Desk((300.0, PUSHED), (500.0, AWAY), *slower, (3500.0, BACK)).jog(until_ms=5000.0)
    rows = desk.rig.rows()
    assert set(rows["fault"].tolist()) == {FaultCode.NONE}
    tool = np.array([puma().forward(q)[:3, 3] for q in rows["q_ref"][::50]])
    along, aside = tool[:, 0] - tool[0, 0], np.abs(tool[:, 1:] - tool[0, 1:]).max()
    assert aside < 1e-3
    speed = np.diff(along) / 0.1 * 1e3  # mm/s
    for share in (1.0, 0.5):
        assert np.count_nonzero(np.abs(speed - share * AXIS_MM_S) <= 0.05 * share * AXIS_MM_S) >= 8  # as long as it may
    begin, end = desk.moving_ms
    assert end - begin < 3000.0 + BRAKE_MS
    assert "axes of the base" in desk.said[0]


def test_a_device_that_is_lost_stops_the_arm_and_ends_the_session() -> None:
    desk = Desk((300.0, PUSHED), (500.0, AWAY), (1500.0, "lost"))
    with pytest.raises(LinkError, match="pad is gone"):
        desk.jog(until_ms=9000.0)
    begin, end = desk.moving_ms
    assert end - begin < 1000.0 + BRAKE_MS
