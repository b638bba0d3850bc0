"""Modbus modules beside a board: inputs in STATUS, a gripper that follows the hand, and safe values in silence."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from qrobot.config import load_deployment
from qrobot.config.modbus_io import ModbusIo
from qrobot.errors import ConfigError
from qrobot.hwif.bus import make_image
from qrobot.hwif.memory import IMAGE_INPUTS, OP_WRITE
from qrobot.hwif.modbus.device import ModbusDevice
from qrobot.hwif.modbus.io import NS_PER_MS, IoBus, RemoteModule
from qrobot.hwif.modbus.server import ModbusServer
from qrobot.hwif.registers import DAC, DISCRETE, DISCRETE_HAND_CLOSE, DISCRETE_HAND_OPEN, STATUS, STATUS_POWER
from qrobot.hwif.roads import open_road
from tests.support.bus import DirectBus
from tests.support.paper_board import PaperBoard

GRIPPER = DAC // 2
OPEN, CLOSE = DISCRETE_HAND_CLOSE, DISCRETE_HAND_OPEN  # active low: the solenoid whose bit is off is on
RELAX = OPEN | CLOSE
PATIENCE_S = 5.0
FILE = """
[[arm]]
name = "left"
robot = "puma560"
bridge = { port = 5600 }
servo = { board_timeout_ms = 10 }
[arm.board]
"""
TWICE = '[[arm.board.io]]\nhost = "127.0.0.1"\ninputs = [{ address = 0, input = 1 }, { address = 9, input = 1 }]\n'
IO = TWICE.replace("address = 9, input = 1", "address = 9, input = 2")


@dataclass
class Table:
    """A module whose inputs are the STATUS bits of a board of paper, and whose gripper is its converters."""

    board: PaperBoard
    module: RemoteModule
    lines: list[str]

    def words(self) -> list[int]:
        return [value for _, _, value in self.board.applied]


@pytest.fixture
def table() -> Iterator[Table]:
    board, lines = PaperBoard(), list[str]()
    with ModbusServer(ModbusDevice(board, watchdog_ms=0)) as server:
        choice = ModbusIo.model_validate(
            {
                "host": "127.0.0.1", "port": server.address[1], "period_ms": 1.0, "timeout_ms": 500.0,
                "inputs": [{"address": 15, "input": 2}, {"address": 0, "input": 4, "safe": True}],
                "gripper": {"address": GRIPPER, "open": [1, 2], "close": [3, 4]},
            }
        )  # fmt: skip
        table = Table(board, RemoteModule(choice, lines.append), lines)
        yield table
        table.module.close()


def test_inputs_of_a_module_stand_where_the_file_says(table: Table) -> None:
    assert table.module.mask == 0b10100
    table.board.status = 1 << 15
    table.module.poll()
    assert table.module.bits(time.monotonic_ns()) == 0b00100
    table.board.status = 1
    table.module.poll()
    assert table.module.bits(time.monotonic_ns()) == 0b10000


def test_what_is_old_or_was_never_seen_reads_as_safe(table: Table) -> None:
    assert table.module.bits(time.monotonic_ns()) == 0b10000
    table.board.status = 1 << 15
    table.module.poll()
    assert table.module.bits(time.monotonic_ns() + 501 * NS_PER_MS) == 0b10000


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


def test_a_board_with_a_module_shows_its_own_bits_and_those_of_the_module(table: Table) -> None:
    main = PaperBoard()
    main.status = STATUS_POWER | 0b00110
    table.board.status = 1
    bus, image = IoBus(DirectBus(main), [table.module]), make_image()
    assert bus.connect().joints == 6
    deadline = time.monotonic() + PATIENCE_S
    while not (table.lines and table.words() == [3, 4]):
        assert time.monotonic() < deadline
        bus.exchange(np.array([(OP_WRITE, DISCRETE, CLOSE)], np.int64), image)
        time.sleep(0.002)
    assert image[IMAGE_INPUTS + STATUS // 2] == STATUS_POWER | 0b10010
    assert main.applied[-1] == (OP_WRITE, DISCRETE, CLOSE)
    bus.close()
    bus.close()


@pytest.mark.parametrize(
    ("board", "says"),
    [
        (IO, r"modules need a board behind a gateway, and kind = 'emulator' has none"),
        ('kind = "modbus"\nmodbus = {}\n' + TWICE, "two remote inputs stand for the same input 1"),
        ('kind = "modbus"\nmodbus = {}\n[[arm.board.io]]\nhost = "x"\n', "does nothing"),
    ],
)
def test_modules_that_make_no_sense_are_refused(tmp_path: Path, board: str, says: str) -> None:
    path = tmp_path / "here.toml"
    path.write_text(FILE + board)
    with pytest.raises(ConfigError, match=says):
        load_deployment(path)


def test_a_module_in_a_deployment_file_stands_before_the_road_to_its_board(tmp_path: Path) -> None:
    path = tmp_path / "here.toml"
    path.write_text(
        FILE + 'kind = "modbus"\nmodbus = {}\n' + IO.replace("address = 9, input = 1", "address = 9, input = 2")
    )
    [arm] = load_deployment(path).arm
    bus, _ = open_road(arm.board)
    assert isinstance(bus, IoBus)
