"""The clock of a board behind a gateway: too fast a one hides speed, gets no power and keeps none."""

from __future__ import annotations

from collections.abc import Callable
from itertools import accumulate

import pytest

from qrobot.config import load_robot
from qrobot.faultcodes import NO_JOINT, FaultCode
from qrobot.hwif.image import IMAGE_T_NS
from qrobot.modecodes import Mode
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator

ROBOT = load_robot("puma560")
RATE_HZ = 500.0


class Gateway(LockstepRig):
    """A rig whose images are asked for by our clock and stamped by that of the board, which goes at `pace`."""

    def __init__(self, pace: float = 1.0) -> None:
        super().__init__(ROBOT, ServoSettings(rate_hz=RATE_HZ), Emulator(ROBOT, start="ready", physics="rigid"))
        self.pace, self._ours_ns, self._theirs_ns = pace, 0, 1e9

    def go(self, seconds: float, pace: Callable[[float], float] | None = None) -> Gateway:
        """Run; `pace` by the seconds since then, if it changes."""
        for k in range(round(seconds * RATE_HZ)):
            self.ticks(1)
            image, facts = self.board.shown.image, self.board.facts
            facts.taken_ns = int(image[IMAGE_T_NS])
            self._theirs_ns += (self.pace if pace is None else pace(k / RATE_HZ)) * (facts.taken_ns - self._ours_ns)
            self._ours_ns = facts.taken_ns
            image[IMAGE_T_NS] = int(self._theirs_ns)
        return self

    def powered(self) -> Gateway:
        self.mailbox.request_power(True)
        return self.go(0.5)

    @property
    def told(self) -> tuple[Mode, FaultCode]:
        state = self.mailbox.snapshot()
        assert state.event_joint == NO_JOINT
        return Mode(state.mode), FaultCode(state.event)


@pytest.mark.parametrize("pace", [1.4, 3.0, 1000.0])
def test_a_clock_that_goes_faster_than_ours_stops_the_arm_within_two_seconds(pace: float) -> None:
    """Two whole seconds of it: the one in which it begins does not count."""
    rig = Gateway().go(0.1).powered()
    assert rig.told[0] is Mode.HOLDING
    rig.go(0.9)
    rig.pace = pace
    rig.go(3.1)
    assert rig.told == (Mode.FAULT, FaultCode.BOARD_CLOCK)
    rig.go(0.5)
    assert not rig.emulator.powered


def test_a_board_with_such_a_clock_gets_no_power_and_does_when_it_goes_as_ours() -> None:
    rig = Gateway(pace=3.0).go(2.5).powered()
    assert rig.told == (Mode.OFF, FaultCode.BOARD_CLOCK)
    assert not rig.emulator.powered
    rig.pace = 1.0
    rig.go(2.1)
    assert rig.told[0] is Mode.OFF  # it does not come by itself
    rig.mailbox.request_power(False)
    assert rig.go(0.1).powered().told == (Mode.HOLDING, FaultCode.NONE)


STALLS = [(0.9, 0.3), (0.4, 0.2), (0.8, 0.1)]  # from stall to stall, and how long the board stands still, s


def stalled(t: float) -> float:
    """Pace of a board that is kept from running now and then, and catches up in the 50 ms behind it."""
    for begin, (_, length) in zip(accumulate(after for after, _ in STALLS), STALLS, strict=True):
        if begin <= t < begin + length:
            return 1e-3
        if begin + length <= t < begin + length + 0.05:
            return 1.0 + length / 0.05
    return 1.0


@pytest.mark.parametrize(
    "pace",
    [lambda _: 1.0, lambda _: 1.2, lambda _: 0.5, stalled],
    ids=["as ours", "a fifth faster", "half as fast", "catching up"],
)
def test_a_clock_that_goes_as_ours_or_slower_or_catches_up_costs_nobody_the_power(
    pace: Callable[[float], float],
) -> None:
    rig = Gateway().go(0.1).powered()
    rig.go(4.0, pace)
    assert rig.told == (Mode.HOLDING, FaultCode.NONE)
