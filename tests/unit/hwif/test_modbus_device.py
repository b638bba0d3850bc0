"""What a Modbus server does with requests: one writer at a time, nothing twice, and a board that is safe in silence."""

from __future__ import annotations

import pytest

from qrobot.errors import LinkBusy, LinkError, RemoteProtocolError
from qrobot.hwif.modbus.device import NS_PER_MS, ModbusDevice
from qrobot.hwif.modbus.map import (
    AGE,
    ANOTHER,
    APPLIED,
    CONTROL,
    DROPPED,
    IDENTITY,
    IMAGE,
    MAILBOX,
    NOBODY,
    REFUSED,
    ROBOT,
    TRIPS,
    WATCHDOG,
    WINDOW,
    YOU,
)
from qrobot.hwif.operations import OP_READ, OP_WRITE
from qrobot.hwif.registers import (
    ADC_START,
    DAC,
    DAC_ZERO,
    DISCRETE,
    DISCRETE_CALIBRATED,
    DISCRETE_HAND_RELAXED,
    ENC_COUNT,
    ENC_LOAD,
    N_DACS,
    STATUS_CALIBRATED,
    STATUS_POWER,
)
from tests.support.paper_board import PaperBoard, Row

SAFE = [(OP_WRITE, DAC + 2 * channel, DAC_ZERO) for channel in range(N_DACS)]


class Counter:
    """A board of paper behind its map, and two clients."""

    def __init__(self, **options: object) -> None:
        self.board = PaperBoard()
        self.now_ns = 0
        self.lines: list[str] = []
        self.pauses, self.runs = 0, True
        self.device = ModbusDevice(
            self.board,
            100.0,
            lambda: self.now_ns,
            self.lines.append,
            pause=self._pause,
            **options,  # type: ignore[arg-type]
        )
        self.ann, self.bob = object(), object()

    def _pause(self, _seconds: float) -> None:
        self.pauses += 1
        if self.runs:
            self.board.show()

    def register(self, address: int, client: object = None) -> int:
        blocks = self.device.read(client, address, 2)
        first = max(start for start in blocks if start <= address)
        return blocks[first][address - first]

    def post(self, sequence: int, *rows: Row, client: object = None) -> None:
        registers = [word for kind, offset, value in rows for word in (kind << 8 | offset, value)]
        self.device.write(client or self.ann, MAILBOX, [sequence, len(rows), *registers])

    def wait(self, milliseconds: float) -> bool:
        self.now_ns += round(milliseconds * NS_PER_MS)
        return self.device.watch()


@pytest.fixture
def counter() -> Counter:
    return Counter()


def test_registers_are_written_in_the_order_of_addresses_and_can_be_read_back(counter: Counter) -> None:
    counter.device.write(counter.ann, DAC // 2, [1, 2, 3])
    assert counter.board.applied == [(OP_WRITE, DAC, 1), (OP_WRITE, DAC + 2, 2), (OP_WRITE, DAC + 4, 3)]
    assert [counter.register(DAC // 2 + i) for i in range(3)] == [1, 2, 3]


def test_a_mailbox_is_applied_once_however_often_it_comes(counter: Counter) -> None:
    for _ in range(3):
        counter.post(7, (OP_WRITE, ENC_LOAD, 5), (OP_READ, ADC_START, 0))
    assert counter.board.applied == [(OP_WRITE, ENC_LOAD, 5), (OP_READ, ADC_START, 0)]
    assert counter.register(APPLIED) == counter.register(MAILBOX) == 7
    counter.post(8, (OP_WRITE, ENC_LOAD, 6))
    assert counter.board.applied[2:] == [(OP_WRITE, ENC_LOAD, 6)]


@pytest.mark.parametrize(
    ("address", "values"),
    [(MAILBOX, [1]), (MAILBOX + 2, [1, 2]), (MAILBOX, [1, 2, 0x130, 0]), (MAILBOX, [1, 1, 0x231, 0])],
)
def test_a_mailbox_that_means_nothing_changes_nothing(counter: Counter, address: int, values: list[int]) -> None:
    with pytest.raises(RemoteProtocolError):
        counter.device.write(counter.ann, address, values)
    assert not counter.board.applied
    assert counter.register(CONTROL) == NOBODY


def test_coils_are_bits_of_discrete_and_leave_the_others_alone(counter: Counter) -> None:
    counter.board.status = STATUS_CALIBRATED
    counter.device.write_coils(counter.ann, 0, [True])
    counter.device.write_coils(counter.ann, 1, [False, True])
    words = [value for _, _, value in counter.board.applied]
    assert words == [DISCRETE_CALIBRATED | DISCRETE_HAND_RELAXED | 1, DISCRETE_CALIBRATED | 0b101]
    assert counter.device.coils() == words[-1]
    counter.board.status = STATUS_POWER
    assert counter.device.discrete_inputs() == STATUS_POWER


def test_adc_start_acts_when_it_is_read_by_itself_and_not_with_its_neighbours(counter: Counter) -> None:
    counter.device.read(counter.ann, WINDOW, 16)
    counter.device.read(counter.ann, ADC_START // 2, 2)
    assert not counter.board.applied
    counter.device.read(counter.ann, ADC_START // 2, 1)
    assert counter.board.applied == [(OP_READ, ADC_START, 0)]


def test_a_second_writer_is_refused_and_counted_and_may_read(counter: Counter) -> None:
    counter.device.write(counter.ann, DAC // 2, [1])
    for refused in (1, 2):
        with pytest.raises(LinkBusy, match="another client"):
            counter.device.write(counter.bob, DAC // 2, [2])
        assert counter.register(REFUSED, counter.bob) == refused
    assert (counter.register(CONTROL, counter.ann), counter.register(CONTROL, counter.bob)) == (YOU, ANOTHER)
    assert counter.board.applied == [(OP_WRITE, DAC, 1)]


def test_the_control_is_free_when_its_holder_has_left(counter: Counter) -> None:
    counter.device.write(counter.ann, DAC // 2, [1])
    counter.device.leave(counter.bob)
    assert counter.register(CONTROL) == ANOTHER
    counter.device.leave(counter.ann)
    counter.device.write(counter.bob, DAC // 2, [2])
    assert counter.register(CONTROL, counter.bob) == YOU


def test_a_client_in_control_that_falls_silent_leaves_a_safe_board_once(counter: Counter) -> None:
    counter.board.status = STATUS_CALIBRATED | STATUS_POWER
    counter.device.write(counter.ann, DAC // 2, [0])
    counter.board.applied.clear()
    assert not counter.wait(100)
    assert counter.wait(1)
    assert counter.board.applied == [*SAFE, (OP_WRITE, DISCRETE, DISCRETE_CALIBRATED | DISCRETE_HAND_RELAXED)]
    assert not counter.wait(1000)
    assert (counter.register(TRIPS), counter.register(CONTROL)) == (1, NOBODY)
    assert counter.register(DAC // 2) == DAC_ZERO
    assert "silent for 100 ms" in counter.lines[-1]


def test_reading_is_a_sign_of_life_of_the_client_in_control_only(counter: Counter) -> None:
    counter.device.write(counter.ann, DAC // 2, [0])
    counter.wait(60)
    counter.device.hear(counter.ann)
    assert not counter.wait(60)
    counter.device.hear(counter.bob)
    assert counter.wait(60)


def test_what_a_client_leaves_behind_is_made_safe_too_and_it_goes_on_normally_when_it_is_back(counter: Counter) -> None:
    counter.device.write(counter.ann, DAC // 2, [0])
    counter.device.leave(counter.ann)
    assert counter.wait(101)
    counter.device.write(counter.ann, DAC // 2, [3])
    assert counter.board.applied[-1] == (OP_WRITE, DAC, 3)
    assert counter.device.trips == 1
    assert counter.wait(101)
    assert counter.device.trips == 2


def test_a_server_that_nobody_has_written_to_never_acts(counter: Counter) -> None:
    counter.device.read(counter.ann, WINDOW, 16)
    assert not counter.wait(10_000)
    assert not counter.board.applied


def test_a_watchdog_that_is_switched_off_never_acts(counter: Counter) -> None:
    counter.device.watchdog_ns = 0
    counter.device.write(counter.ann, DAC // 2, [0])
    assert not counter.wait(1e6)
    assert counter.register(WATCHDOG) == 0


def test_operations_that_the_board_does_not_take_are_counted_and_not_shown_as_written(counter: Counter) -> None:
    counter.device.write(counter.ann, DAC // 2, [1])
    counter.board.full = True
    with pytest.raises(LinkError):
        counter.device.write(counter.ann, DAC // 2, [2, 3])
    assert (counter.register(DROPPED), counter.register(DAC // 2)) == (2, 1)


def test_a_board_that_is_away_is_told_and_the_watchdog_survives_it(counter: Counter) -> None:
    counter.device.write(counter.ann, DAC // 2, [1])
    counter.board.gone = True
    for address in (WINDOW, IMAGE, IDENTITY):
        with pytest.raises(LinkError):
            counter.device.read(counter.ann, address, 1)
    assert counter.wait(101)
    assert "could not be made safe" in counter.lines[-1]
    assert not counter.wait(1)  # told once, and tried again
    assert "could not be made safe" in counter.lines[-1]
    told, before = len(counter.lines), len(counter.board.applied)
    counter.board.gone = False
    assert not counter.wait(1)
    assert counter.board.applied[before : before + len(SAFE)] == SAFE
    assert not counter.wait(1)
    assert len(counter.board.applied) == before + len(SAFE) + 1  # and DISCRETE
    assert len(counter.lines) == told
    assert counter.device.trips == 1


def test_a_client_that_comes_while_the_board_is_away_does_not_have_the_control(counter: Counter) -> None:
    counter.board.gone = True
    with pytest.raises(LinkError):
        counter.device.write_coils(counter.bob, 0, [True])
    assert counter.device.control(counter.ann) == NOBODY


def test_a_client_reads_in_the_window_what_it_has_written_although_the_board_shows_it_later(counter: Counter) -> None:
    counter.board.lag = 2
    counter.device.write(counter.ann, ENC_LOAD // 2, [7])
    assert counter.register(ENC_COUNT // 2, counter.bob) == 0  # another client has no fence
    assert counter.register(ENC_COUNT // 2, counter.ann) == 7
    assert counter.pauses == 1
    assert counter.register(ENC_COUNT // 2, counter.ann) == 7
    assert counter.pauses == 1  # once is enough


def test_the_image_is_read_as_it_is_and_a_board_that_stands_still_is_not_waited_for_without_end(
    counter: Counter,
) -> None:
    counter.board.lag, counter.runs = 2, False
    counter.device.write(counter.ann, ENC_LOAD // 2, [7])
    counter.register(IMAGE, counter.ann)
    assert counter.pauses == 0
    assert counter.register(ENC_COUNT // 2, counter.ann) == 0
    assert 0 < counter.pauses <= 100


def test_an_image_that_stands_still_grows_old(counter: Counter) -> None:
    counter.register(AGE)
    counter.now_ns += 30 * NS_PER_MS
    assert counter.register(AGE) == 30
    counter.post(1, (OP_WRITE, DAC, 0))
    assert counter.register(AGE) == 0


def test_where_a_servo_has_the_board_nobody_may_write() -> None:
    counter = Counter(holder="the servo", robot=lambda: [3, 7])
    with pytest.raises(LinkBusy):
        counter.device.write(counter.ann, DAC // 2, [0])
    with pytest.raises(LinkBusy):
        counter.device.write_coils(counter.ann, 0, [True])
    with pytest.raises(LinkBusy):
        counter.device.read(counter.ann, ADC_START // 2, 1)
    counter.device.leave("somebody")
    assert not counter.wait(1e6)
    assert not counter.board.applied
    assert counter.register(CONTROL) == ANOTHER
    assert [counter.register(ROBOT + i) for i in range(2)] == [3, 7]
