"""Power of separate drives: all come up together, one that fails keeps the others off, and it is named."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.hwif.canbus.drive_power import OPERATE_PATIENCE_MS, TELL_AFTER_MS, DrivesPower
from qrobot.hwif.canbus.ds402 import DISABLE_VOLTAGE, ENABLE_OPERATION, FAULT_RESET, DriveState
from qrobot.hwif.canbus.setpoints import DriveFeedback
from qrobot.hwif.operations import OP_WRITE
from qrobot.hwif.registers import DISCRETE, DISCRETE_POWER, STATUS_POWER
from tests.support.bus import BenchEndpoint, Row
from tests.support.drives import NODES, Drives, served
from tests.support.emulated_drives import EmulatedDrive
from tests.support.faulty_drive import OVERCURRENT, FaultyDrive

ON: Row = (OP_WRITE, DISCRETE, DISCRETE_POWER)
OFF: Row = (OP_WRITE, DISCRETE, 0)
STEPS_UP = 4
SEVERAL = 30  # exchanges: six times the way up, and a reset
PERIOD_MS = 10.0
ON_THE_WAY = [DriveState.SWITCH_ON_DISABLED, DriveState.READY, DriveState.SWITCHED_ON, DriveState.ENABLED]
NOT_IN_OPERATION = [state for state in DriveState if state is not DriveState.ENABLED]


@pytest.fixture
def drives() -> Iterator[Drives]:
    with served(BenchEndpoint()) as drives:
        drives.bus.connect()
        yield drives


def in_operation(drives: Drives) -> int:
    return sum(drive.state is DriveState.ENABLED for drive in drives.far.drives)


def give_way(drives: Drives, node: int, faulty: EmulatedDrive) -> None:
    """Put another drive into the place of a node's."""
    at = NODES.index(node)
    faulty.operational, faulty.mode = drives.far.drives[at].operational, drives.far.drives[at].mode
    drives.far.drives[at] = faulty


class Bench:
    """Drives without a wire, which answer each exchange at once."""

    def __init__(self) -> None:
        self.drives = {node: EmulatedDrive() for node in NODES}
        self.heard = {node: DriveFeedback(0) for node in NODES}
        self.emergencies: dict[int, int] = {}
        self.lines: list[str] = []
        self.power = DrivesPower(self.heard, PERIOD_MS, self.emergencies.get, self.lines.append)
        self.words: dict[int, list[int]] = {node: [] for node in NODES}

    def exchange(self) -> None:
        for node, drive in self.drives.items():
            word = DISABLE_VOLTAGE if self.power.tripped else self.power.lead(node)
            self.words[node].append(word)
            drive.control(word)
        for node, drive in self.drives.items():
            self.heard[node].hear(drive.status, 0)
        if not self.power.tripped:
            self.power.judge()

    @property
    def operating(self) -> int:
        return sum(drive.state is DriveState.ENABLED for drive in self.drives.values())


class StuckDrive(EmulatedDrive):
    """A drive that obeys nothing."""

    def control(self, word: int) -> None:
        pass


class LateDrive(EmulatedDrive):
    """A drive that waits before it operates."""

    exchanges = 0

    def control(self, word: int) -> None:
        if word == ENABLE_OPERATION and self.state is DriveState.SWITCHED_ON and self.exchanges > 0:
            self.exchanges -= 1
        else:
            super().control(word)


@pytest.mark.parametrize("node", [1, 2, 6])
@pytest.mark.parametrize("at_once", [True, False])
@pytest.mark.parametrize("at", ON_THE_WAY)
def test_a_drive_that_faults_on_the_way_up_lets_the_others_operate_for_one_exchange_at_most(
    drives: Drives, at: DriveState, at_once: bool, node: int
) -> None:
    faulty = FaultyDrive(DriveState.FAULT, at=at, at_once=at_once)
    give_way(drives, node, faulty)
    alone = 0
    for _ in range(SEVERAL):
        drives.exchange(ON)
        alone += 0 < in_operation(drives) < len(NODES)
    assert alone <= 1
    assert faulty.enabled <= 1
    assert in_operation(drives) == 0


@pytest.mark.parametrize("state", NOT_IN_OPERATION)
def test_a_drive_that_leaves_operation_by_itself_is_named_with_its_state_and_what_it_complained_of(
    drives: Drives, state: DriveState
) -> None:
    assert drives.exchange(ON, times=STEPS_UP) & STATUS_POWER
    drives.far.fail(3, OVERCURRENT)
    give_way(drives, 3, StuckDrive(state))
    drives.exchange(ON, times=3)
    name = state.name.replace("_", " ")
    assert drives.lines == [f"all drives are switched off: node 3 is in {name} (emergency message 0x2310)"]
    assert in_operation(drives) == 0


def test_power_that_is_asked_for_and_given_back_is_told_to_nobody(drives: Drives) -> None:
    for steps in (STEPS_UP, 1, 2, 3, STEPS_UP):
        drives.exchange(ON, times=steps)
        drives.exchange(OFF, times=2)
    assert drives.lines == []


@pytest.mark.parametrize("state", [state for state in NOT_IN_OPERATION if state is not DriveState.SWITCHED_ON])
def test_a_drive_that_cannot_be_led_up_keeps_all_others_off_and_is_named(state: DriveState) -> None:
    bench = Bench()
    bench.drives[6], bench.emergencies[6] = StuckDrive(state), OVERCURRENT
    for _ in range(round(2 * TELL_AFTER_MS / PERIOD_MS)):
        bench.exchange()
        assert bench.operating == 0
    name = state.name.replace("_", " ")
    assert bench.lines == [f"arm power waits for a drive: node 6 is in {name} (emergency message 0x2310)"]


@pytest.mark.parametrize(("spare_ms", "comes"), [(0.0, True), (2 * PERIOD_MS, False)])
def test_a_drive_that_operates_later_than_the_others_is_waited_for_only_so_long(spare_ms: float, comes: bool) -> None:
    bench = Bench()
    late = bench.drives[4] = LateDrive()
    late.exchanges = round((OPERATE_PATIENCE_MS + spare_ms) / PERIOD_MS)
    for _ in range(STEPS_UP + late.exchanges):
        bench.exchange()
    assert bench.power.on == comes
    assert bench.operating == (len(NODES) if comes else 0)
    assert bench.lines == ([] if comes else ["all drives are switched off: node 4 is in SWITCHED ON"])


def test_a_fault_from_before_is_reset_once_for_each_time_that_power_is_asked_for() -> None:
    bench = Bench()
    for _ in range(2):
        bench.drives[2] = FaultyDrive(DriveState.FAULT, at=DriveState.READY)
        for _ in range(SEVERAL):
            bench.exchange()
        assert bench.power.tripped
        assert bench.words[2].count(FAULT_RESET) == 1
        bench.words[2].clear()
        bench.power.forget()
    bench.drives[2] = EmulatedDrive(DriveState.FAULT)
    for _ in range(STEPS_UP + 2):
        bench.exchange()
    assert bench.power.on


EVENTS = st.tuples(st.integers(0, 40), st.sampled_from(NODES), st.sampled_from(list(DriveState)))


@given(st.lists(EVENTS, max_size=8), st.lists(st.integers(0, 15), min_size=6, max_size=6))
def test_whatever_drives_do_none_operates_for_long_while_another_one_does_not(
    events: list[tuple[int, int, DriveState]], delays: list[int]
) -> None:
    bench = Bench()
    for node, delay in zip(NODES, delays, strict=True):
        late = bench.drives[node] = LateDrive()
        late.exchanges = delay
    apart, tripped = 0, False
    for exchange in range(60):
        for at, node, state in events:
            if at == exchange:
                bench.drives[node].state = state
        bench.exchange()
        assert not (tripped and bench.operating)
        tripped = bench.power.tripped
        forced = any(at in (exchange - 1, exchange) for at, _, _ in events)  # a drive that operates of its own accord
        apart = apart + 1 if 0 < bench.operating < len(NODES) and not forced else 0
        assert apart <= OPERATE_PATIENCE_MS / PERIOD_MS + 1
