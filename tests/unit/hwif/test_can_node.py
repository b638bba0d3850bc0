"""The board's CAN node, frame by frame: states, emergencies, the watchdog, service data, and garbage."""

from __future__ import annotations

import struct
from types import SimpleNamespace

import can
import numpy as np
import pytest

from qrobot.errors import ConfigError
from qrobot.hwif.canbus.frames import EMCY, HEARTBEAT, RPDO, SDO_ANSWER, SDO_ASK, SYNC, TPDO, encode_operations
from qrobot.hwif.canbus.node import (
    CLIENT_SILENT,
    EMERGENCY_STOP,
    LIST_TORN,
    LOST_POWER,
    WITHOUT_MEANING,
    BoardNode,
)
from qrobot.hwif.canbus.objects import COUNTERS_OBJECT, PRODUCER_HEARTBEAT, register_index
from qrobot.hwif.canbus.service import analog_value, dac_word
from qrobot.hwif.operations import OP_READ, OP_WRITE
from qrobot.hwif.registers import (
    ADC_START,
    DAC,
    DAC_ZERO,
    DISCRETE,
    DISCRETE_HAND_RELAXED,
    DISCRETE_POWER,
    ENC_COUNT,
    ENC_LOAD,
    N_DACS,
    STATUS_POWER,
)
from tests.support.bus import BenchEndpoint, Row, rows_of
from tests.support.virtual_clock import VirtualClock

NODE = 5
SAFE = [(OP_WRITE, DAC + 2 * channel, DAC_ZERO) for channel in range(N_DACS)]
SAFE.append((OP_WRITE, DISCRETE, DISCRETE_HAND_RELAXED))
START, STOP, PRE_OPERATIONAL, RESET = 0x01, 0x02, 0x80, 0x81
WRITE_TWO_BYTES, READ = 0x2B, 0x40


class Wire:
    """A CAN interface without a wire: what the node sends is kept."""

    def __init__(self) -> None:
        self.sent: list[tuple[int, bytes]] = []

    def send(self, message: can.Message, _timeout: float | None = None) -> None:
        self.sent.append((message.arbitration_id, bytes(message.data)))

    def recv(self, _timeout: float | None = None) -> None:
        return None


class Desk:
    """A node, the bench behind it, and somebody who sends frames."""

    def __init__(self, watchdog_ms: float = 0.0) -> None:
        self.wire, self.end, self.clock = Wire(), BenchEndpoint(), VirtualClock()
        self.node = BoardNode(self.wire, self.end, NODE, watchdog_ms, now_ns=self.clock)  # type: ignore[arg-type]
        self.node.boot()

    def put(self, can_id: int, data: bytes = b"") -> list[tuple[int, bytes]]:
        """What the node answers to a frame."""
        self.wire.sent.clear()
        self.node.take(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))
        return list(self.wire.sent)

    def command(self, command: int, node: int = NODE) -> None:
        self.put(0, bytes((command, node)))

    def post(self, *rows: Row) -> None:
        for frame in encode_operations(rows_of(rows)):
            self.put(RPDO[0] + NODE, frame)

    def sync(self, counter: int = 1) -> list[tuple[int, bytes]]:
        return self.put(SYNC, bytes((counter,)))

    def write(self, index: int, sub: int, value: int) -> int:
        """Expedited download of two bytes; the abort code, 0 for none."""
        [(can_id, data)] = self.put(SDO_ASK + NODE, struct.pack("<BHBL", WRITE_TWO_BYTES, index, sub, value))
        assert can_id == SDO_ANSWER + NODE
        return int.from_bytes(data[4:], "little") if data[0] == 0x80 else 0

    def read(self, index: int, sub: int) -> int:
        [(_, data)] = self.put(SDO_ASK + NODE, struct.pack("<BHBL", READ, index, sub, 0))
        assert data[0] != 0x80, f"aborted: {data[4:].hex()}"
        return int.from_bytes(data[4:], "little")

    @property
    def emergencies(self) -> list[int]:
        """Codes among what was sent last."""
        return [int.from_bytes(data[:2], "little") for can_id, data in self.wire.sent if can_id == EMCY + NODE]


@pytest.fixture
def desk() -> Desk:
    desk = Desk()
    desk.command(START)
    return desk


def test_a_node_says_that_it_has_started_and_waits_to_be_let_operate() -> None:
    desk = Desk()
    assert (HEARTBEAT + NODE, b"\0") in desk.wire.sent
    assert desk.node.state == "PRE-OPERATIONAL"
    desk.post((OP_WRITE, DAC, 1))
    assert desk.sync() == []
    assert desk.end.lists == []


def test_a_command_to_another_node_is_none_and_one_to_all_is(desk: Desk) -> None:
    desk.command(STOP, NODE + 1)
    assert desk.node.state == "OPERATIONAL"
    desk.command(STOP, 0)
    assert desk.node.state == "STOPPED"


@pytest.mark.parametrize("command", [STOP, PRE_OPERATIONAL, RESET])
def test_leaving_the_operational_state_makes_the_board_safe(desk: Desk, command: int) -> None:
    desk.post((OP_WRITE, DAC, 5), (OP_WRITE, DISCRETE, DISCRETE_POWER | DISCRETE_HAND_RELAXED))
    desk.sync()
    desk.post((OP_WRITE, DAC, 7))
    desk.command(command)
    assert desk.end.lists[-1] == SAFE
    assert (OP_WRITE, DAC, 7) not in desk.end.applied
    desk.command(START)
    desk.sync()
    assert desk.end.lists[-1] == []  # nothing from before


def test_operations_wait_for_the_sync_and_are_answered_by_five_frames_in_a_row(desk: Desk) -> None:
    desk.post((OP_WRITE, DAC, 5), (OP_READ, ADC_START, 0))
    assert desk.end.lists == []
    answer = desk.sync(9)
    assert desk.end.lists == [[(OP_WRITE, DAC, 5), (OP_READ, ADC_START, 0)]]
    assert [can_id for can_id, _ in answer] == [base + NODE for base in TPDO]
    assert answer[0][1][:2] == bytes((9, 1))


def test_plain_process_data_reach_converters_and_outputs_before_the_mailbox(desk: Desk) -> None:
    desk.post((OP_WRITE, DAC, 99))
    desk.put(RPDO[3] + NODE, struct.pack("<H", DISCRETE_HAND_RELAXED))
    desk.put(RPDO[1] + NODE, struct.pack("<4H", 1, 2, 3, 4))
    desk.put(RPDO[2] + NODE, struct.pack("<4H", 5, 6, 7, 8))
    desk.sync()
    converters = [(OP_WRITE, DAC + 2 * channel, channel + 1) for channel in range(N_DACS)]
    assert desk.end.lists == [[*converters, (OP_WRITE, DISCRETE, DISCRETE_HAND_RELAXED), (OP_WRITE, DAC, 99)]]


def test_outputs_are_refused_by_service_data_while_the_node_does_not_operate(desk: Desk) -> None:
    assert desk.write(register_index(ENC_LOAD), 2, 77) == 0
    assert desk.read(register_index(ENC_COUNT), 2) == 77
    desk.command(PRE_OPERATIONAL)
    desk.end.lists.clear()
    assert desk.write(register_index(DAC), 1, 77) == 0x08000022
    assert desk.end.lists == []
    assert desk.read(register_index(ENC_COUNT), 2) == 77


def test_reading_adc_start_starts_a_conversion_and_reading_a_counter_does_nothing(desk: Desk) -> None:
    desk.read(register_index(ENC_COUNT), 1)
    assert desk.end.lists == []
    desk.read(register_index(ADC_START), 1)
    assert desk.end.lists == [[(OP_READ, ADC_START, 0)]]


@pytest.mark.parametrize(
    ("value", "word"), [(0, DAC_ZERO), (16, 0x7FF), (-16, 0x801), (32767, 1), (-32768, 0xFFF), (15, DAC_ZERO)]
)
def test_an_analogue_output_is_volts_and_zero_is_zero(value: int, word: int) -> None:
    """V = (0x800 - n) / 204.8 (TRC004 vendor driver v4.3) and value / 3276.8."""
    assert dac_word(value) == word
    if abs(value) < 32768 - 16:
        assert (DAC_ZERO - word) / 204.8 == pytest.approx(value / 3276.8, abs=1 / 204.8)


def test_an_analogue_input_is_volts_on_either_revision() -> None:
    assert analog_value(0x8000, "F") == -32768
    assert analog_value(0x7FFF, "F") == 0x7FF0
    assert analog_value(0xAB00 + 255, "E") == round(5.0 * 3276.8)


def test_lost_power_and_the_emergency_stop_are_told_once_each_and_that_they_are_over(desk: Desk) -> None:
    desk.post((OP_WRITE, DISCRETE, DISCRETE_POWER | DISCRETE_HAND_RELAXED))
    head = desk.sync()[0][1]
    assert int.from_bytes(head[2:4], "little") & STATUS_POWER
    assert desk.emergencies == []
    desk.end.bench.memory.panel.estop = 1
    desk.sync()
    assert sorted(desk.emergencies) == [LOST_POWER, EMERGENCY_STOP]
    desk.sync()
    assert desk.emergencies == []
    desk.end.bench.memory.panel.estop = 0
    desk.post((OP_WRITE, DISCRETE, DISCRETE_HAND_RELAXED))
    desk.sync()
    assert desk.emergencies == [0]


def test_power_that_was_switched_off_is_no_emergency(desk: Desk) -> None:
    desk.post((OP_WRITE, DISCRETE, DISCRETE_POWER | DISCRETE_HAND_RELAXED))
    desk.sync()
    desk.post((OP_WRITE, DISCRETE, DISCRETE_HAND_RELAXED))
    desk.sync()
    desk.sync()
    assert desk.emergencies == []


def desk_of_a_silent_client() -> Desk:
    """One whose client has written once, longer ago than the watchdog waits."""
    desk = Desk(watchdog_ms=5.0)
    desk.command(START)
    desk.post((OP_WRITE, DAC, 5))
    desk.sync()
    desk.clock.pass_ms(5.1)
    return desk


def test_a_silent_client_makes_the_board_safe_once_and_may_go_on() -> None:
    desk = desk_of_a_silent_client()
    desk.node.step(0.0)
    desk.node.step(0.0)
    assert desk.end.lists[1:] == [SAFE]
    assert desk.emergencies == [CLIENT_SILENT]
    assert desk.node.expired == 1
    desk.post((OP_WRITE, DAC, 6))
    assert len(desk.sync()) == len(TPDO) + 1
    assert desk.emergencies == [0]
    assert desk.end.lists[-1] == [(OP_WRITE, DAC, 6)]


def test_a_list_of_which_no_sync_came_is_forgotten_when_the_client_begins_anew(desk: Desk) -> None:
    """The SYNC was lost, and the client looks for the node again, which is still operating."""
    desk.command(START)
    desk.post((OP_WRITE, DAC, 5), (OP_WRITE, DISCRETE, DISCRETE_POWER))
    desk.put(RPDO[1] + NODE, struct.pack("<4h", 1, 2, 3, 4))
    desk.command(START)
    desk.sync()
    assert desk.end.applied == []


def test_a_board_that_cannot_be_made_safe_is_tried_again_until_it_is() -> None:
    desk = desk_of_a_silent_client()
    desk.end.gone = True
    for _ in range(5):
        desk.node.step(0.0)
    assert desk.node.expired == 1
    desk.end.gone = False
    desk.node.step(0.0)
    assert desk.end.lists[1:] == [SAFE]
    desk.node.step(0.0)
    assert desk.end.lists[1:] == [SAFE]
    assert desk.emergencies == [CLIENT_SILENT]


@pytest.mark.parametrize("command", [STOP, PRE_OPERATIONAL, RESET])
def test_a_board_that_was_away_when_its_client_left_is_made_safe_when_it_is_back(desk: Desk, command: int) -> None:
    desk.post((OP_WRITE, DAC, 5), (OP_WRITE, DISCRETE, DISCRETE_POWER | DISCRETE_HAND_RELAXED))
    desk.sync()
    desk.end.gone = True
    desk.command(command)
    desk.node.step(0.0)
    desk.end.gone = False
    desk.node.step(0.0)
    desk.node.step(0.0)
    assert desk.end.lists[1:] == [SAFE]


def test_commands_to_another_node_are_no_sign_of_life_of_the_client() -> None:
    desk = Desk(watchdog_ms=5.0)
    desk.command(START)
    desk.post((OP_WRITE, DAC, 5))
    desk.sync()
    for _ in range(6):
        desk.clock.pass_ms(1.0)
        for command in (START, PRE_OPERATIONAL, RESET):
            desk.command(command, NODE + 1)
        desk.node.step(0.0)
    assert desk.end.lists[1:] == [SAFE]
    assert desk.node.expired == 1


@pytest.mark.parametrize("alive", [0, NODE])
def test_a_command_to_the_node_or_to_all_is_a_sign_of_life(alive: int) -> None:
    desk = Desk(watchdog_ms=5.0)
    desk.command(START)
    for _ in range(6):
        desk.clock.pass_ms(1.0)
        desk.command(START, alive)
        desk.node.step(0.0)
    assert desk.node.expired == 0


def test_a_node_that_does_not_operate_has_no_watchdog() -> None:
    desk = Desk(watchdog_ms=1.0)
    desk.clock.pass_ms(5.0)
    desk.node.step(0.0)
    assert desk.end.lists == []


def test_a_torn_list_is_told_and_not_counted_as_done(desk: Desk) -> None:
    first, second = encode_operations(rows_of([(OP_WRITE, DAC, 1), (OP_WRITE, DISCRETE, 1)]))
    for frames in ([first], [second], [second, first]):
        for frame in frames:
            desk.put(RPDO[0] + NODE, frame)
        head = desk.sync()[-5][1]
        assert head[1] == 0
    assert desk.end.applied == []
    assert desk.node.torn == 3
    assert LIST_TORN not in desk.emergencies  # told at the first one, and it still stands
    assert desk.read(COUNTERS_OBJECT, 2) == 3


def test_the_heartbeat_comes_from_the_loop_and_tells_the_state(desk: Desk) -> None:
    assert desk.write(PRODUCER_HEARTBEAT, 0, 1) == 0
    desk.wire.sent.clear()
    desk.node.step(0.0)
    assert desk.wire.sent == [(HEARTBEAT + NODE, b"\x05")]
    desk.clock.pass_ms(2.0)
    desk.command(PRE_OPERATIONAL)
    desk.node.step(0.0)
    assert desk.wire.sent[-1] == (HEARTBEAT + NODE, b"\x7f")


@pytest.mark.parametrize("node_id", [0, 96, 127])
def test_a_node_number_without_room_for_its_frames_is_refused(node_id: int) -> None:
    with pytest.raises(ConfigError, match="1 to 95"):
        BoardNode(SimpleNamespace(), BenchEndpoint(), node_id)  # type: ignore[arg-type]


def test_no_frame_whatever_it_holds_moves_a_board_that_does_not_operate_or_ends_the_node() -> None:
    desk, random = Desk(), np.random.default_rng(5)
    ids = [0, SYNC, SDO_ASK + NODE, *(base + NODE for base in RPDO), *range(0x700, 0x710)]
    for _ in range(3000):
        can_id = int(random.choice(ids)) if random.random() < 0.8 else int(random.integers(0x800))
        data = random.bytes(int(random.integers(9)))
        if can_id == 0 and data[:1] == b"\1":
            continue  # the one command that lets it operate
        desk.put(can_id, data)
    assert desk.end.lists == []
    assert desk.node.meaningless > 100
    assert desk.read(COUNTERS_OBJECT, 3) == desk.node.meaningless
    desk.command(START)
    assert len([frame for frame in desk.sync() if frame[0] != EMCY + NODE]) == len(TPDO)


def test_frames_of_a_wrong_length_move_nothing_and_are_told_once(desk: Desk) -> None:
    random = np.random.default_rng(6)
    told = []
    for can_id in (*(base + NODE for base in RPDO), SDO_ASK + NODE, 0):
        for length in (0, 1, 3, 5, 7):
            desk.put(can_id, random.bytes(length))
            told += desk.emergencies
    assert desk.node.meaningless == 30
    assert told == [WITHOUT_MEANING]
    assert len(desk.sync()) >= len(TPDO)
    assert desk.end.applied == []


def lose(frames: list[bytes], at: int) -> list[bytes]:
    return frames[:at] + frames[at + 1 :]


def repeat(frames: list[bytes], at: int) -> list[bytes]:
    return frames[: at + 1] + frames[at:]


def swap(frames: list[bytes], at: int) -> list[bytes]:
    other = (at + 1) % len(frames)
    swapped = list(frames)
    swapped[at], swapped[other] = frames[other], frames[at]
    return swapped


def mix_in(frames: list[bytes], at: int) -> list[bytes]:
    return frames[:at] + encode_operations(rows_of([(OP_WRITE, DISCRETE, DISCRETE_POWER)])) + frames[at:]


@pytest.mark.parametrize("damage", [lose, repeat, swap, mix_in])
def test_an_operating_node_does_nothing_of_a_list_that_a_wire_has_damaged_and_counts_it(desk: Desk, damage) -> None:
    random = np.random.default_rng(8)
    offsets = range(ENC_LOAD, DAC + 2 * N_DACS, 4)  # every write in a frame of its own
    for k in range(1, 201):
        size = int(random.integers(2, 12))
        rows = [(OP_WRITE, int(random.choice(offsets)), int(random.integers(0x10000))) for _ in range(size)]
        for frame in damage(
            encode_operations(rows_of(rows)), int(random.integers(len(encode_operations(rows_of(rows)))))
        ):
            desk.put(RPDO[0] + NODE, frame)
        assert len([frame for frame in desk.sync(k) if frame[0] != EMCY + NODE]) == len(TPDO)
        assert desk.node.torn == k
    assert desk.end.applied == []
    assert desk.read(COUNTERS_OBJECT, 2) == 200
    desk.post((OP_WRITE, DAC, 0x123))
    desk.sync()
    assert desk.end.applied == [(OP_WRITE, DAC, 0x123)]


def test_an_operating_node_takes_no_noise_for_a_command_and_goes_on(desk: Desk) -> None:
    random = np.random.default_rng(9)
    lengths = {0: (0, 1, 3, 8), SYNC: (2, 8), SDO_ASK + NODE: (0, 4, 7)} | {base + NODE: (0, 1, 5, 7) for base in RPDO}
    for k in range(2_000):
        can_id = int(random.choice(list(lengths)))
        desk.put(can_id, random.bytes(int(random.choice(lengths[can_id]))))
        assert desk.node.meaningless == k + 1
    assert desk.end.applied == []
    assert desk.node.state == "OPERATIONAL"
    assert len([frame for frame in desk.sync() if frame[0] != EMCY + NODE]) == len(TPDO)
    assert desk.read(COUNTERS_OBJECT, 3) == 2_000
