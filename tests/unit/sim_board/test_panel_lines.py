"""The panel of an emulated board worked by lines, and what a look at the board then tells."""

from __future__ import annotations

from typing import Any

import pytest

from qrobot.config.deployment import BoardChoice
from qrobot.config.modbus_io import ModbusIo, RemoteInput, RemoteOutput
from qrobot.errors import ConfigError
from qrobot.hwif.board_look import BoardLooker
from qrobot.hwif.board_memory import BoardMemory, local_board_memory, publish_image
from qrobot.hwif.image import IMAGE_ADC_VALUE as ADC
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_ENC_COUNT, IMAGE_STATUS, make_image
from qrobot.hwif.registers import DAC, DISCRETE
from qrobot.hwif.trace import trace_write
from qrobot.sim_board.panel_lines import force_panel


@pytest.fixture
def memory() -> BoardMemory:
    memory = local_board_memory()
    memory.facts.joints, memory.facts.revision, memory.facts.now_ns = 6, ord("F"), 1
    return memory


def test_lines_work_the_panel_and_clear_takes_them_back(memory: BoardMemory) -> None:
    for line in ("estop on", "power press", "input:1 on", "input:5 on", "input:1 off", "analog:7 -1.5", "push:6 20"):
        force_panel(memory, line)
    panel = memory.panel
    assert (panel.estop, panel.presses, panel.inputs) == (1, 1, 1 << 5)
    assert (panel.analog[7], panel.push[5]) == (-1_500_000, 20_000_000)
    force_panel(memory, "clear")
    assert (panel.estop, panel.presses, panel.inputs) == (0, 1, 0)
    assert not panel.analog.any()
    assert not panel.push.any()


@pytest.mark.parametrize(
    "line",
    ["", "estop", "estop maybe", "estop:1 on", "power on", "input on", "input:0 on", "input:6 on", "analog:8 1",
     "analog:1 nan", "analog:1 11", "push:0 1", "push:7 1", "push:1 1e9", "push:1 x", "clear all", "dac:1 5"],
)  # fmt: skip
def test_a_line_that_says_what_cannot_be_is_refused_and_changes_nothing(memory: BoardMemory, line: str) -> None:
    before = bytes(memory.panel)  # type: ignore[call-overload]
    with pytest.raises(ConfigError):
        force_panel(memory, line)
    assert bytes(memory.panel) == before  # type: ignore[call-overload]


def test_a_look_tells_words_in_their_units_bits_by_name_and_the_newest_writes(memory: BoardMemory) -> None:
    image = make_image()
    image[IMAGE_COUNT], image[IMAGE_STATUS], image[IMAGE_ENC_COUNT + 1], image[ADC] = 7, 0x8009, 0xFFFE, 0xC000
    publish_image(memory, image)
    choice = BoardChoice(
        io=(
            ModbusIo(
                host="io",
                inputs=(RemoteInput(address=0, input=3),),
                outputs=(RemoteOutput(output=2, name="lamp", address=1),),
            ),
        )
    )
    looker = BoardLooker(memory, choice)

    def rows() -> dict[str, tuple[Any, str]]:
        return {row["name"]: (row["word"], row["told"]) for row in looker.look()["registers"]}

    assert rows()["ENC_COUNT 2"] == (0xFFFE, "-2 counts")
    assert rows()["ADC_VALUE"] == (0xC000, "-5.000 V")
    assert rows()["DAC 1"] == (None, "not written yet")
    trace_write(memory, 1, 0, DAC, 0)
    trace_write(memory, 2, 0, DAC, 0x800 + 1024)
    trace_write(memory, 3, 0, DISCRETE, 0x0001)
    assert rows()["DAC 1"] == (0xC00, "-5.000 V")
    trace_write(memory, 4, 0, DAC + 14, 0)
    assert rows()["DAC 8"] == (0, "+10.000 V")
    memory.panel.outputs = 0b10
    seen = looker.look()
    assert seen["count"] == 7
    assert rows()["DAC 1"][0] == 0xC00
    on = {(bit["register"], bit["name"]) for bit in seen["bits"] if bit["on"]}
    closed = ("STATUS", "emergency stop chain is closed")
    assert on == {("STATUS", "arm power is on"), ("STATUS", "input 3"), closed, ("DISCRETE", "arm power enable")}
    (module,) = seen["modules"]
    assert module["lines"] == ["input 3: on", "output 2, lamp: on"]
    memory.facts.revision = ord("E")
    image[ADC] = 0x00FF
    publish_image(memory, image)
    assert rows()["ADC_VALUE"][1] == "5.000 V"
