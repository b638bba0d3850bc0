"""Of a stop and a request that would move the arm the stop counts, when one cycle sees both."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import pytest

from qrobot.errors import LinkTimeout, ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.operator.calibration_client import run_calibration
from tests.support.calibrating import CalibratingRig

FRAME_NS = 28_000_000
HALTS = [ServoMailbox.request_stop, ServoMailbox.request_power_off]

Halt = Callable[[ServoMailbox], None]


class Beginning(NamedTuple):
    """A request that begins motion or power: of which arm, and from which mode it leads to which."""

    arm: Callable[[], CalibratingRig]
    request: Callable[[CalibratingRig], object]
    before: Mode
    after: Mode


def uncalibrated() -> CalibratingRig:
    return CalibratingRig().powered()


def unpowered() -> CalibratingRig:
    """Its power waits for no potentiometer."""
    rig = CalibratingRig(calibrated=True, table=None)
    rig.run_for(0.5)
    return rig


def held() -> CalibratingRig:
    return CalibratingRig(calibrated=True).powered()


def begin_stream(rig: CalibratingRig) -> None:
    """A frame that begins to be played in the next cycle."""
    n, at = rig.robot.n, rig.now_ns - FRAME_NS
    rig.mailbox.push_setpoint(1, 0, at, FRAME_NS, [POSITION_SETPOINT] * n, rig.seen.q_setpoint.tolist())


BEGINNINGS = [
    Beginning(uncalibrated, lambda rig: rig.mailbox.request_calibration(), Mode.UNCALIBRATED, Mode.CALIBRATING),
    Beginning(unpowered, lambda rig: rig.mailbox.request_power(True), Mode.OFF, Mode.POWERING),
    Beginning(held, begin_stream, Mode.HOLDING, Mode.TRACKING),
]
TO = [beginning.after.name for beginning in BEGINNINGS]


def modes(rig: CalibratingRig, cycles: int) -> set[Mode]:
    """What the servo is in during the next cycles."""
    seen = set()
    for _ in range(cycles):
        rig.ticks(1)
        seen.add(rig.mode)
    return seen


@pytest.mark.parametrize("beginning", BEGINNINGS, ids=TO)
def test_each_of_these_requests_is_obeyed_in_the_next_cycle(beginning: Beginning) -> None:
    rig = beginning.arm()
    assert rig.mode is beginning.before
    beginning.request(rig)
    assert modes(rig, 1) == {beginning.after}


@pytest.mark.parametrize("halt", HALTS)
@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("beginning", BEGINNINGS, ids=TO)
def test_a_halt_in_the_cycle_of_a_request_counts_whichever_came_first(
    beginning: Beginning, first: bool, halt: Halt
) -> None:
    rig = beginning.arm()
    acts: list[Callable[[], object]] = [lambda: halt(rig.mailbox), lambda: beginning.request(rig)]
    for act in acts if first else acts[::-1]:
        act()
    last = beginning.before if halt is ServoMailbox.request_stop else Mode.OFF
    assert modes(rig, 300) == {last}


def test_a_calibration_that_a_stop_took_back_is_told_and_can_be_asked_for_again() -> None:
    rig = uncalibrated()
    rig.mailbox.request_calibration()
    rig.mailbox.request_stop()
    rig.ticks(1)
    assert rig.event[0] is FaultCode.CAL_STOPPED
    rig.mailbox.request_calibration()
    assert modes(rig, 3) == {Mode.CALIBRATING}


# ------------------------------------------------------------------------------------------------ the command line's


@pytest.mark.parametrize("halt", HALTS)
@pytest.mark.parametrize("cycles", [0, 1, 3])
def test_a_halt_just_before_the_command_asks_for_a_calibration_is_not_overruled(
    monkeypatch: pytest.MonkeyPatch, halt: Halt, cycles: int
) -> None:
    """Behind its last look at the halts, and so many cycles before its request."""
    rig = uncalibrated()
    request = rig.mailbox.request_calibration

    def late(indexes: int) -> None:
        halt(rig.mailbox)
        rig.ticks(cycles)
        request(indexes)

    monkeypatch.setattr(rig.mailbox, "request_calibration", late)
    with pytest.raises(ServoFault, match="not calibrated: CAL_STOPPED"):
        rig.calibrate(3)
    assert Mode.CALIBRATING not in modes(rig, 300)


@pytest.mark.parametrize("halt", HALTS)
@pytest.mark.parametrize("cycles", [0, 1, 3])
def test_a_halt_just_before_the_command_asks_for_power_is_not_overruled(
    monkeypatch: pytest.MonkeyPatch, halt: Halt, cycles: int
) -> None:
    rig = CalibratingRig()
    rig.run_for(0.5)
    request = rig.mailbox.request_power

    def late(on: bool) -> None:
        if on:
            halt(rig.mailbox)
            rig.ticks(cycles)
        request(on)

    monkeypatch.setattr(rig.mailbox, "request_power", late)
    with pytest.raises(ServoFault, match="not calibrated: CAL_STOPPED"):
        rig.calibrate(3)
    assert modes(rig, 300) == {Mode.OFF}


@pytest.mark.parametrize("arm", [CalibratingRig, uncalibrated])
@pytest.mark.parametrize("stalls", [1, 2, 3, 5])
def test_the_command_follows_a_calibration_of_a_loop_that_stands_still_when_it_is_asked(
    arm: Callable[[], CalibratingRig], stalls: int
) -> None:
    """As one does whose machine is busy with other work, or whose emulated time stands still."""
    rig, left = arm(), iter(range(stalls))

    def wait(seconds: float) -> None:
        asked = rig.mailbox.memory.command.calibrations > 0
        if not asked or next(left, None) is None:
            rig.run_for(seconds)

    assert run_calibration(rig.mailbox, wait, 3).votes == [3] * rig.robot.n
    assert rig.exact()


def test_a_loop_that_stands_still_for_too_long_does_not_calibrate_when_it_goes_on() -> None:
    rig = uncalibrated()
    with pytest.raises(LinkTimeout, match="does not run"):
        run_calibration(rig.mailbox, lambda _: None, 3)
    assert modes(rig, 300) == {Mode.UNCALIBRATED}
