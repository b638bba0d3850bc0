"""Drives of CiA 402 in cyclic synchronous position mode, exchange by exchange: what they are told, and when to stop."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from qrobot.errors import LinkTimeout, RemoteProtocolError
from qrobot.hwif.canbus.drives import DrivesBus
from qrobot.hwif.canbus.ds402 import CYCLIC_POSITION, CYCLIC_TORQUE, DriveState
from qrobot.hwif.operations import OP_REFERENCE, OP_WRITE, REFERENCE_PER_COUNT
from qrobot.hwif.registers import DAC, DISCRETE, DISCRETE_POWER, ENC_LOAD, STATUS_ESTOP_OK, STATUS_POWER
from tests.support.bus import BenchEndpoint, Row
from tests.support.drive_loop import PositionLoop
from tests.support.drives import INCREMENTS, NODES, Drives, served
from tests.support.patience import wait_until

ON: Row = (OP_WRITE, DISCRETE, DISCRETE_POWER)
OFF: Row = (OP_WRITE, DISCRETE, 0)
STEPS_UP = 4
PATIENCE = 10  # exchanges of 2 ms: twice the period of a servo at 100 Hz


@pytest.fixture
def drives() -> Iterator[Drives]:
    with served(BenchEndpoint(), loops=[PositionLoop(1.0, 1.0) for _ in range(6)]) as drives:
        drives.bus.connect()
        yield drives


def references(counts: float) -> list[Row]:
    return [(OP_REFERENCE, joint, round(counts * REFERENCE_PER_COUNT) & 0xFFFFFFFF) for joint in range(6)]


def turn(drives: Drives, counts: float) -> None:
    drives.far.end.bench.shaft[:] = counts  # type: ignore[attr-defined]
    drives.exchange(times=2)


def targets(drives: Drives) -> list[int]:
    return [drive.target for drive in drives.far.drives]


def in_increments(counts: float) -> list[int]:
    return [round(counts * increments) for increments in INCREMENTS]


def power_on(drives: Drives) -> None:
    assert drives.exchange(ON, times=STEPS_UP) & STATUS_POWER


def test_drives_are_switched_on_in_position_mode_and_hold_where_they_are(drives: Drives) -> None:
    turn(drives, 500.0)
    power_on(drives)
    assert {drive.mode for drive in drives.far.drives} == {CYCLIC_POSITION}
    turn(drives, 520.0)  # pushed
    assert targets(drives) == in_increments(500.0)


def test_a_reference_is_a_target_in_increments_to_a_fraction_of_a_count(drives: Drives) -> None:
    power_on(drives)
    drives.exchange(*references(-12.25))
    assert targets(drives) == in_increments(-12.25)


def test_references_mean_the_nearest_position_as_counters_wrap(drives: Drives) -> None:
    for counts in (20_000.0, 40_000.0):  # further than a counter's sign
        turn(drives, counts)
    power_on(drives)
    drives.exchange(*references(40_010.5 - 65_536.0))
    assert targets(drives) == pytest.approx(in_increments(40_010.5), abs=1)


def test_references_go_nowhere_before_every_drive_is_in_operation(drives: Drives) -> None:
    for _ in range(STEPS_UP - 1):
        drives.exchange(ON, *references(300.0))
        assert targets(drives) == [0] * 6


def test_converter_words_mean_nothing_in_position_mode(drives: Drives) -> None:
    power_on(drives)
    drives.exchange(*references(7.0))
    drives.exchange(*((OP_WRITE, DAC + 2 * joint, 0) for joint in range(6)))
    assert targets(drives) == in_increments(7.0)
    assert {drive.torque for drive in drives.far.drives} == {0}


def test_drives_to_which_nobody_says_where_to_be_any_more_stop_quickly_until_power_is_taken_away(
    drives: Drives,
) -> None:
    power_on(drives)
    assert drives.exchange(times=2 * PATIENCE) & STATUS_POWER  # nothing was said yet
    drives.exchange(*references(5.0))
    assert drives.exchange(times=PATIENCE) & STATUS_POWER
    assert not drives.exchange(times=2) & (STATUS_POWER | STATUS_ESTOP_OK)
    drives.exchange(*references(6.0), times=3)
    assert {drive.state for drive in drives.far.drives} == {DriveState.QUICK_STOPPED}
    drives.exchange(OFF)
    power_on(drives)
    assert drives.exchange(times=2 * PATIENCE) & STATUS_ESTOP_OK


def test_a_drive_that_fails_takes_the_others_along_in_position_mode_too(drives: Drives) -> None:
    power_on(drives)
    drives.exchange(*references(5.0))
    drives.far.fail(3, 0x2310)
    assert not drives.exchange(*references(5.0), times=2) & STATUS_POWER
    assert {drive.state for drive in drives.far.drives} == {DriveState.SWITCH_ON_DISABLED, DriveState.FAULT}


def test_when_one_drive_is_silent_the_others_stop_quickly_where_they_are(drives: Drives) -> None:
    power_on(drives)
    drives.exchange(*references(5.0))
    drives.silent.add(3)
    drives.hurry()
    with pytest.raises(LinkTimeout):
        drives.exchange(*references(6.0))
    others = [drive for node, drive in zip(NODES, drives.far.drives, strict=True) if node != 3]
    wait_until(lambda: {drive.state for drive in others} == {DriveState.QUICK_STOPPED})
    assert targets(drives) == in_increments(6.0)


def test_drives_that_have_not_told_where_they_are_get_no_target(drives: Drives) -> None:
    turn(drives, 500.0)
    power_on(drives)
    after, before = DrivesBus(drives.transport), targets(drives)
    after.connect()
    assert targets(drives) == before
    assert {drive.state for drive in drives.far.drives} == {DriveState.ENABLED}
    after.close()


def test_counters_are_loaded_only_while_no_drive_is_in_operation(drives: Drives) -> None:
    load: list[Row] = [(OP_WRITE, ENC_LOAD + 2 * joint, 100) for joint in range(6)]
    drives.exchange(*load)
    assert drives.counts() == [100] * 6
    power_on(drives)
    drives.exchange(*((kind, offset, 900) for kind, offset, _ in load))
    assert drives.counts() == [100] * 6
    drives.exchange(*references(103.0))
    assert targets(drives) == in_increments(3.0)


def test_a_drive_that_refuses_position_mode_is_named(drives: Drives) -> None:
    drives.far.drives[4].loop = None
    with pytest.raises(RemoteProtocolError, match="node 5"):
        drives.bus.connect()


def test_a_drive_that_shows_another_mode_is_refused(drives: Drives, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(type(drives.far.drives[0]), "mode", property(lambda _: CYCLIC_TORQUE, lambda *_: None))
    with pytest.raises(RemoteProtocolError, match="node 1 has no cyclic synchronous position mode"):
        drives.bus.connect()
