"""Modbus modules beside a board: inputs in STATUS, a gripper that follows the hand, and safe values in silence."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from qrobot.cli.servo_settings import servo_settings
from qrobot.config import load_deployment
from qrobot.config.modbus_io import ModbusIo
from qrobot.errors import ConfigError, LinkError
from qrobot.hwif.board_memory import local_board_memory
from qrobot.hwif.bus import sane_operations
from qrobot.hwif.converter import adc_word
from qrobot.hwif.image import IMAGE_ADC_VALUE, IMAGE_STATUS, make_image
from qrobot.hwif.modbus.device import ModbusDevice
from qrobot.hwif.modbus.io import NS_PER_MS, IoBus, RemoteModule
from qrobot.hwif.modbus.panel import PanelModules
from qrobot.hwif.modbus.server import ModbusServer
from qrobot.hwif.operations import ALL_ANALOG, OP_ANALOG, OP_OUTPUTS, OP_WRITE
from qrobot.hwif.registers import (
    ADC_F_CHANNEL_SHIFT,
    ADC_MUX,
    DAC,
    DISCRETE,
    DISCRETE_HAND_CLOSE,
    DISCRETE_HAND_OPEN,
    ENC_COUNT,
    STATUS_ADC_BUSY,
    STATUS_POWER,
)
from qrobot.hwif.trace import trace_write
from qrobot.hwif.transports import modules_beside, open_transport
from tests.support.bus import DirectBus
from tests.support.deployment import LEFT
from tests.support.paper_board import PaperBoard
from tests.support.patience import MOMENT_S, PATIENCE_MS, wait_until
from tests.support.relay import Relay, as_it_came
from tests.support.thorough import examples
from tests.support.virtual_clock import VirtualClock

GRIPPER = DAC // 2
OPEN, CLOSE = DISCRETE_HAND_CLOSE, DISCRETE_HAND_OPEN  # active low: the solenoid whose bit is off is on
RELAX = OPEN | CLOSE
VALVE, PUMP = 3, GRIPPER + 3  # a coil that is a bit of DISCRETE, a register
HEATER = GRIPPER + 4  # the register of an analogue output
VALVE_1, PUMP_3 = 0b001, 0b100
AGE_NS = round(PATIENCE_MS + 1) * NS_PER_MS  # too old
TWICE = '[[arm.board.io]]\nhost = "127.0.0.1"\ninputs = [{ address = 0, input = 1 }, { address = 9, input = 1 }]\n'
IO = TWICE.replace("address = 9, input = 1", "address = 9, input = 2")


@dataclass
class Table:
    """A module whose inputs are the STATUS bits of a board of paper, and whose gripper is its converters."""

    board: PaperBoard
    module: RemoteModule
    lines: list[str]
    clock: VirtualClock
    choice: ModbusIo

    def words(self) -> list[int]:
        return [value for _, offset, value in self.board.applied if DAC <= offset < 2 * PUMP]


@pytest.fixture
def table() -> Iterator[Table]:
    board, lines, clock = PaperBoard(), list[str](), VirtualClock()
    with ModbusServer(ModbusDevice(board, watchdog_ms=0, now_ns=clock)) as server:
        choice = ModbusIo.model_validate(
            {
                "host": "127.0.0.1", "port": server.address[1], "period_ms": 1.0,
                "inputs": [{"address": 15, "input": 2}, {"address": 0, "input": 4, "safe": True}],
                "analog": [{"address": ENC_COUNT // 2, "channel": 6, "volt_per_count": 0.001, "zero_v": 0.5}],
                "gripper": {"address": GRIPPER, "open": [1, 2], "close": [3, 4]},
                "outputs": [
                    {"address": VALVE, "output": 1, "on": 0, "off": 1},
                    {"address": PUMP, "output": 3, "kind": "register", "on": 700, "on_stop": "hold"},
                ],
                "analog_outputs": [
                    {"address": HEATER, "output": 2, "volt_per_count": 0.001, "zero_v": 0.5, "off_v": -1.0}
                ],
            }
        )  # fmt: skip
        patient = choice.model_copy(update={"timeout_ms": PATIENCE_MS})  # longer than a file may ask for
        table = Table(board, RemoteModule(patient, lines.append, clock), lines, clock, patient)
        yield table
        table.module.close()


def test_inputs_of_a_module_stand_where_the_file_says(table: Table) -> None:
    assert table.module.mask == 0b10100
    table.board.status = 1 << 15
    table.module.poll()
    assert table.module.bits(table.clock()) == 0b00100
    table.board.status = 1
    table.module.poll()
    assert table.module.bits(table.clock()) == 0b10000


def test_what_is_old_or_was_never_seen_reads_as_safe(table: Table) -> None:
    assert table.module.bits(table.clock()) == 0b10000
    table.board.status = 1 << 15
    table.module.poll()
    assert table.module.bits(table.clock() + AGE_NS) == 0b10000


class Polls:
    """A stop that comes after three polls, and notes the waits between them, ms."""

    def __init__(self) -> None:
        self.waits: list[float] = []

    def is_set(self) -> bool:
        return len(self.waits) == 3

    def wait(self, seconds: float) -> None:
        self.waits.append(1e3 * seconds)


@pytest.mark.parametrize(("takes_ms", "left_ms"), [(0.0, 1.0), (0.4, 0.6), (1.0, 0.0), (5.0, 0.0)])
def test_a_module_is_asked_once_a_period_whatever_its_answers_take(
    table: Table, takes_ms: float, left_ms: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A value counts from when it was asked for, and has to until there is a newer one."""
    monkeypatch.setattr(table.module, "poll", lambda: table.clock.pass_ms(takes_ms))
    stop: Any = Polls()
    table.module.run(stop)
    assert stop.waits == pytest.approx([left_ms] * 3)


def test_an_analogue_input_is_a_signed_register_in_volts_and_has_no_value_when_it_is_old(table: Table) -> None:
    assert table.module.maybe_volt(6, table.clock()) is None
    table.board.inputs[ENC_COUNT // 2] = 0x10000 - 1500
    table.module.poll()
    now_ns = table.clock()
    assert table.module.maybe_volt(6, now_ns) == pytest.approx(-2.0)
    assert table.module.maybe_volt(6, now_ns + AGE_NS) is None
    assert table.module.maybe_volt(5, now_ns) is None


def test_what_a_slow_module_says_counts_from_when_it_was_asked_and_is_told_when_it_is_too_old_in_between(
    table: Table,
) -> None:
    """Three answers, each after a fifth of the time for which they count."""
    patience_ms, clock = table.choice.timeout_ms, VirtualClock()  # not that of the server

    def late(answer: bytes) -> bytes:
        clock.pass_ms(patience_ms / 5)
        return answer

    with Relay(("127.0.0.1", table.choice.port)) as relay:
        near = table.choice.model_copy(update={"port": relay.port, "analog_outputs": ()})
        module = RemoteModule(near, table.lines.append, clock)
        relay.spoil = late
        table.board.status = 1 << 15
        module.poll()
        clock.pass_ms(0.3 * patience_ms)
        assert module.bits(clock()) == 0b00100
        assert module.maybe_volt(6, clock()) is not None
        clock.pass_ms(0.2 * patience_ms)
        assert module.bits(clock()) == 0b10000
        assert module.maybe_volt(6, clock()) is None
        module.poll()
        module.poll()
        module.close()
    found, slow = table.lines
    assert found.endswith("found")
    assert "is slow: what it says is older than timeout_ms" in slow


def test_a_conversion_of_a_remote_channel_never_reaches_the_board(table: Table) -> None:
    main = PaperBoard()
    bus, image = IoBus(DirectBus(main), [table.module], table.clock), make_image()
    table.board.inputs[ENC_COUNT // 2] = 3000
    table.module.poll()
    ours, boards = ((OP_WRITE, ADC_MUX, channel << ADC_F_CHANNEL_SHIFT) for channel in (6, 5))
    bus.exchange(np.array([ours], np.int64), image)
    assert main.applied == []
    assert image[IMAGE_ADC_VALUE] == adc_word(2.5)
    assert not image[IMAGE_STATUS] & STATUS_ADC_BUSY
    bus.exchange(np.array([boards], np.int64), image)
    assert main.applied == [boards]
    assert image[IMAGE_ADC_VALUE] == 0


def test_a_remote_channel_without_a_value_is_never_converted(table: Table) -> None:
    bus, image = IoBus(DirectBus(PaperBoard()), [table.module], table.clock), make_image()
    bus.exchange(np.array([(OP_WRITE, ADC_MUX, 6 << ADC_F_CHANNEL_SHIFT)], np.int64), image)
    assert image[IMAGE_STATUS] & STATUS_ADC_BUSY


def test_a_board_of_revision_e_takes_no_remote_channels(table: Table) -> None:
    with pytest.raises(LinkError, match="board of revision F"):
        IoBus(DirectBus(PaperBoard("E")), [table.module]).connect()


@pytest.mark.parametrize(("volt", "word"), [(0.0, 0), (10.0, 0x7FF0), (-10.0, 0x8000), (99.0, 0x7FF0), (5.0, 0x4000)])
def test_volts_become_twelve_bits_within_ten_volts(volt: float, word: int) -> None:
    assert adc_word(volt) == word


def test_beside_an_emulated_board_a_module_works_the_panel_and_its_gripper_follows_the_hand(table: Table) -> None:
    memory = local_board_memory()
    memory.panel.inputs = 0b00010  # somebody else's
    panel = PanelModules(memory, [table.module])
    table.board.status, table.board.inputs[ENC_COUNT // 2] = 1 << 15, 3000
    for t_ns, (offset, value) in enumerate([(DISCRETE, OPEN), (DISCRETE, CLOSE), (DAC, 7)]):
        trace_write(memory, t_ns, 0, offset, value)
    table.module.poll()
    panel.step(table.clock())
    assert memory.panel.inputs == 0b00110
    assert memory.panel.analog[6] == 2_500_000
    table.module.poll()
    assert table.words() == [3, 4]
    table.board.gone = True
    table.module.poll()
    panel.step(table.clock() + AGE_NS)
    assert memory.panel.inputs == 0b10010  # its safe ones
    assert memory.panel.analog[6] == 0
    assert memory.facts.module_losses == 1


def test_modules_of_a_deployment_file_work_the_panel_of_its_emulated_board_until_it_ends(tmp_path: Path) -> None:
    board, lines, memory = PaperBoard(), list[str](), local_board_memory()
    board.status = 1
    with ModbusServer(ModbusDevice(board, watchdog_ms=0, now_ns=VirtualClock())) as server:
        path = tmp_path / "here.toml"
        module = f'[[arm.board.io]]\nhost = "127.0.0.1"\nport = {server.address[1]}\n'
        path.write_text(LEFT + module + "timeout_ms = 10_000\ninputs = [{ address = 0, input = 3 }]\n")
        [arm] = load_deployment(path).arm
        with modules_beside(arm.board, memory, lines.append):
            wait_until(lambda: memory.panel.inputs == 0b01000, "the panel shows the input")
    assert [line.split()[-1] for line in lines] == ["found"]


def test_without_modules_nothing_is_beside_a_board(tmp_path: Path) -> None:
    path = tmp_path / "here.toml"
    path.write_text(LEFT)
    [arm] = load_deployment(path).arm
    before = set(threading.enumerate())
    with modules_beside(arm.board, local_board_memory(), print):
        assert set(threading.enumerate()) <= before


def test_a_gripper_gets_each_command_once_and_again_after_it_was_away(table: Table) -> None:
    table.module.poll()
    assert not table.words()  # nobody has said anything yet
    for discrete, words in ((CLOSE, [3, 4]), (OPEN, [3, 4, 1, 2]), (RELAX, [3, 4, 1, 2]), (0, [3, 4, 1, 2])):
        table.module.command(discrete)
        table.module.poll()
        table.module.poll()
        assert table.words() == words
    table.board.gone = True
    table.module.poll()
    table.module.poll()
    table.board.gone = False
    table.module.poll()
    assert table.words() == [3, 4, 1, 2, 1, 2]
    assert table.module.losses == 1
    assert [line.split(":", 1)[0].split()[0] for line in table.lines] == ["module"] * 3


def valve_and_pump(table: Table) -> list[int | None]:
    """What was last written to either, None for nothing yet."""
    last = {offset: value for _, offset, value in table.board.applied}
    valve = last.get(DISCRETE)
    return [None if valve is None else valve >> VALVE & 1, last.get(2 * PUMP)]


def test_outputs_of_a_module_get_their_numbers_when_they_change_and_again_after_it_was_away(table: Table) -> None:
    table.module.poll()
    assert valve_and_pump(table) == [None, None]  # nobody has said anything yet
    for outputs, seen in ((0, [1, 0]), (VALVE_1, [0, 0]), (VALVE_1 | PUMP_3, [0, 700]), (PUMP_3 | 0xFF00, [1, 700])):
        table.module.switch(outputs)
        table.module.poll()
        assert valve_and_pump(table) == seen
        count = len(table.board.applied)
        table.module.poll()
        assert len(table.board.applied) == count
    table.board.applied.clear()
    table.board.gone = True
    table.module.poll()
    table.board.gone = False
    table.module.poll()
    assert valve_and_pump(table) == [1, 700]


def test_a_module_that_is_let_go_keeps_what_holds_and_switches_the_rest_off(table: Table) -> None:
    table.module.switch(VALVE_1 | PUMP_3)
    table.module.poll()
    stop = threading.Event()
    stop.set()
    table.module.run(stop)
    assert valve_and_pump(table) == [1, 700]


class OnePoll(threading.Event):
    """Set at the first wait: for one poll, and the one that ends it."""

    def wait(self, _timeout: float | None = None) -> bool:
        self.set()
        return True


def test_what_a_module_has_switched_off_comes_on_again_only_when_somebody_says_so_anew(table: Table) -> None:
    switched: list[list[int]] = []
    for said in (VALVE_1 | PUMP_3, None, VALVE_1):  # None: the board is found again, and nobody has spoken since
        table.board.applied.clear()
        if said is not None:
            table.module.switch(said)
        table.module.run(OnePoll())
        table.module.forget()
        switched.append([value >> VALVE & 1 for _, offset, value in table.board.applied if offset == DISCRETE])
    assert switched == [[0, 1], [1], [0, 1]]  # a valve that is on is 0


def test_what_is_said_while_a_module_is_still_being_let_go_of_is_not_lost(table: Table) -> None:
    table.module.switch(VALVE_1)
    table.module.drive(2, 2.0)
    table.module.poll()
    table.module.forget()  # the board is lost
    table.module.switch(VALVE_1)  # and found, before the module has answered
    table.module.drive(2, 2.0)
    table.module.poll(leaving=True)
    assert valve_and_pump(table)[0] == 1
    table.module.poll()
    assert valve_and_pump(table)[0] == 0
    assert heater(table) == [2500, -500, 2500]


class SlowModule(RemoteModule):
    """One whose answer is waited for until `may_go`; `runs` says when each run began, and when it ended."""

    def __init__(self, choice: ModbusIo) -> None:
        super().__init__(choice)
        self.runs: list[str] = []
        self.begun, self.may_go = threading.Semaphore(0), threading.Semaphore(0)

    def run(self, stop: threading.Event) -> None:
        self.runs.append("begins")
        self.begun.release()
        stop.wait()
        self.may_go.acquire()
        self.runs.append("ends")


def test_a_board_is_found_again_before_a_slow_module_has_been_let_go_of(table: Table) -> None:
    module = SlowModule(table.choice)
    bus, image = IoBus(DirectBus(PaperBoard()), [module], table.clock), make_image()
    for _ in range(2):  # found, lost, and found again
        bus.connect()
        bus.exchange(np.array([(OP_OUTPUTS, 0, PUMP_3)], np.int64), image)
        module.begun.acquire()
        assert module.runs[-1] == "begins"
        bus.close()
        bus.connect()
        bus.close()
        module.may_go.release()
        module.begun.acquire()  # one after the other, each lets go of it
        module.may_go.release()
    bus.settle()
    assert module.runs == ["begins", "ends"] * 4


def test_a_module_that_was_never_there_is_told_of_once(table: Table) -> None:
    table.board.gone = True
    table.module.poll()
    table.module.poll()
    assert len(table.lines) == 1
    assert table.lines[0].startswith("no module at Modbus 127.0.0.1")
    table.board.gone = False
    table.module.poll()
    assert table.lines[1].endswith("found")
    assert table.module.losses == 0


@pytest.mark.parametrize("part", ["inputs", "analog"])
@pytest.mark.parametrize("data", [b"\x00", b"\x01"], ids=["no data", "less than told"])
def test_a_module_that_answers_without_data_is_lost_and_found_again(table: Table, part: str, data: bytes) -> None:
    with Relay(("127.0.0.1", table.choice.port)) as relay:
        near = table.choice.model_copy(update={"port": relay.port, part: ()})
        module = RemoteModule(near, table.lines.append, table.clock)
        module.poll()
        relay.spoil = lambda answer: answer[:4] + bytes([0, 2 + len(data)]) + answer[6:8] + data
        module.poll()
        assert module.losses == 1
        assert "lost, its inputs read as safe" in table.lines[-1]
        relay.spoil = as_it_came
        module.poll()
        assert table.lines[-1].endswith("found")
        module.close()


@settings(max_examples=examples(40), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(min_size=1, max_size=16), st.integers(0, 12))
def test_an_answer_of_any_content_does_not_end_the_polling_of_a_module(table: Table, wild: bytes, at: int) -> None:
    with Relay(("127.0.0.1", table.choice.port)) as relay:
        near = table.choice.model_copy(update={"port": relay.port, "timeout_ms": 1e3 * MOMENT_S})
        module = RemoteModule(near, table.lines.append, table.clock)
        relay.spoil = lambda data: data[:at] + wild + data[at + len(wild) :]
        module.poll()
        module.close()


def test_an_analogue_input_in_the_place_of_a_potentiometer_is_refused_with_its_joint(tmp_path: Path) -> None:
    path = tmp_path / "here.toml"
    analog = '[[arm.board.io]]\nhost = "127.0.0.1"\nanalog = [{ address = 0, channel = 5, volt_per_count = 0.001 }]\n'
    path.write_text(LEFT + analog)
    with pytest.raises(ConfigError, match=r"board\.io: channel 5 carries the potentiometer of joint 6"):
        servo_settings(load_deployment(path).arm[0])
    path.write_text(LEFT + "pots = false\n" + analog)
    servo_settings(load_deployment(path).arm[0])


def test_outputs_go_to_modules_beside_a_board_and_not_to_the_board(table: Table) -> None:
    main = PaperBoard()
    bus, image = IoBus(DirectBus(main), [table.module], table.clock), make_image()
    bus.exchange(np.array([(OP_OUTPUTS, 0, PUMP_3), (OP_WRITE, DAC, 9)], np.int64), image)
    table.module.poll()
    assert main.applied == [(OP_WRITE, DAC, 9)]
    assert valve_and_pump(table) == [1, 700]


def heater(table: Table) -> list[int]:
    """What the register of the analogue output has shown, as signed numbers."""
    return [(value ^ 0x8000) - 0x8000 for _, offset, value in table.board.applied if offset == 2 * HEATER]


def test_an_analogue_output_is_a_signed_register_that_is_off_until_somebody_says_what_it_is_to_be(table: Table) -> None:
    for volts in (None, 2.0, 2.0, -3.5, 10.5, nan, 0.0):  # those beyond its range are no volts for it
        if volts is not None:
            table.module.drive(2, volts)
        table.module.drive(7, 9.0)  # another one's
        table.module.poll()
    assert heater(table) == [-500, 2500, -3000, -500, 500]
    table.board.gone = True
    table.module.poll()
    table.board.gone = False
    table.module.poll()
    assert heater(table)[-2:] == [500, 500]  # it may have forgotten
    table.module.drive(2, 1.0)
    table.module.run(OnePoll())
    assert heater(table)[-2:] == [1500, -500]


def test_analogue_outputs_go_to_modules_and_not_to_the_board(table: Table) -> None:
    main = PaperBoard()
    bus, image = IoBus(DirectBus(main), [table.module], table.clock), make_image()
    for operation in ((OP_ANALOG, 1, -2_000_000), (OP_ANALOG, 1, -3_000_000 & 0xFFFFFFFF), (OP_ANALOG, ALL_ANALOG, 0)):
        bus.exchange(sane_operations(np.array([operation, (OP_WRITE, DAC, 9)], np.int64)), image)
        table.module.poll()
    assert heater(table) == [-1500, -2500, -500]
    assert main.applied == [(OP_WRITE, DAC, 9)] * 3
    memory = local_board_memory()
    memory.panel.analog_told, memory.panel.analog_outputs[1] = 0b10, 4_000_000
    panel = PanelModules(memory, [table.module])
    for told in (0b10, 0):
        memory.panel.analog_told = told
        panel.step(table.clock())
        table.module.poll()
    assert heater(table)[-2:] == [4500, -500]


def test_beside_an_emulated_board_modules_follow_the_lamps_of_the_panel(table: Table) -> None:
    memory = local_board_memory()
    memory.panel.outputs = VALVE_1
    PanelModules(memory, [table.module]).step(table.clock())
    table.module.poll()
    assert valve_and_pump(table) == [0, 0]


def test_a_board_with_a_module_shows_its_own_bits_and_those_of_the_module(table: Table) -> None:
    main = PaperBoard()
    main.status = STATUS_POWER | 0b00110
    table.board.status = 1
    bus, image = IoBus(DirectBus(main), [table.module], table.clock), make_image()
    assert bus.connect().joints == 6

    def closed() -> bool:
        bus.exchange(np.array([(OP_WRITE, DISCRETE, CLOSE)], np.int64), image)
        return bool(table.lines) and table.words() == [3, 4]

    wait_until(closed, "the gripper closes")
    assert image[IMAGE_STATUS] == STATUS_POWER | 0b10010
    assert main.applied[-1] == (OP_WRITE, DISCRETE, CLOSE)
    bus.close()
    bus.close()
    bus.settle()


@pytest.mark.parametrize(
    ("board", "says"),
    [
        ('kind = "port"\nport = {}\n' + IO, r"an emulated board or one behind a gateway, and kind = 'port' has none"),
        (TWICE.replace("inputs", "analog").replace("input =", "volt_per_count = 1, channel ="), "the same channel 1"),
        ('kind = "modbus"\nmodbus = {}\n' + TWICE, "two remote inputs stand for the same input 1"),
        (TWICE.replace("inputs", "analog").replace("input =", "volt_per_count = 0, channel ="), "count: 0 is no scale"),
        ('kind = "modbus"\nmodbus = {}\n[[arm.board.io]]\nhost = "x"\n', "does nothing"),
    ],
)
def test_modules_that_make_no_sense_are_refused(tmp_path: Path, board: str, says: str) -> None:
    path = tmp_path / "here.toml"
    path.write_text(LEFT + board)
    with pytest.raises(ConfigError, match=says):
        load_deployment(path)


def test_a_module_in_a_deployment_file_stands_before_the_transport_to_its_board(tmp_path: Path) -> None:
    path = tmp_path / "here.toml"
    path.write_text(
        LEFT + 'kind = "modbus"\nmodbus = {}\n' + IO.replace("address = 9, input = 1", "address = 9, input = 2")
    )
    [arm] = load_deployment(path).arm
    bus = open_transport(arm.board).bus
    assert isinstance(bus, IoBus)
