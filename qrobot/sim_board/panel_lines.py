"""Lines that work the panel of an emulated board: emergency stop, ARM POWER, inputs, analogue values, pushes on joints.

    estop on            power press         input:3 on          analog:2 1.5        push:1 -20          clear

Volts at a channel from 0, N m (N on a sliding joint) at a joint from 1. `clear` takes back everything but the presses.
"""

from __future__ import annotations

import math
import re
from typing import Final

from qrobot.errors import ConfigError
from qrobot.hwif.board_memory import PANEL_MICRO, BoardMemory
from qrobot.hwif.registers import N_ADCS

MOST_VOLT: Final = 10.0
MOST_PUSH: Final = 1000.0
INPUTS: Final = range(1, 6)
_LINE: Final = re.compile(r"(\w+)(?::(\d{1,2}))?(?: +(\S+))?")
_LEVELS: Final = {"on": 1, "off": 0}


def force_panel(memory: BoardMemory, line: str) -> None:
    """Do what a line says. Raises ConfigError: it is none, or says what cannot be."""
    match = _LINE.fullmatch(line.strip())
    forms = {"estop": _estop, "power": _press, "input": _input, "analog": _analog, "push": _push, "clear": _clear}
    if match is None or match[1] not in forms:
        raise ConfigError(f"{line!r} is none of: {', '.join(forms)}; as in 'input:3 on', 'analog:2 1.5', 'estop off'")
    forms[match[1]](memory, None if match[2] is None else int(match[2]), match[3] or "", line)


def _estop(memory: BoardMemory, number: int | None, value: str, line: str) -> None:
    _no_number(number, line)
    memory.panel.estop = _level(value, line)


def _press(memory: BoardMemory, number: int | None, value: str, line: str) -> None:
    _no_number(number, line)
    if value != "press":
        raise ConfigError(f"{line!r}: write 'power press'")
    memory.panel.presses += 1


def _input(memory: BoardMemory, number: int | None, value: str, line: str) -> None:
    bit = 1 << _within(number, INPUTS, "input", line)
    level = _level(value, line)
    memory.panel.inputs = int(memory.panel.inputs) & ~bit | level * bit


def _analog(memory: BoardMemory, number: int | None, value: str, line: str) -> None:
    channel = _within(number, range(N_ADCS), "channel", line)
    memory.panel.analog[channel] = round(_number(value, MOST_VOLT, "V", line) * PANEL_MICRO)


def _push(memory: BoardMemory, number: int | None, value: str, line: str) -> None:
    joint = _within(number, range(1, int(memory.facts.joints) + 1), "joint", line)
    memory.panel.push[joint - 1] = round(_number(value, MOST_PUSH, "N m (N)", line) * PANEL_MICRO)


def _clear(memory: BoardMemory, number: int | None, value: str, line: str) -> None:
    _no_number(number, line)
    if value:
        raise ConfigError(f"{line!r}: write 'clear' alone")
    panel = memory.panel
    panel.estop = panel.inputs = 0
    panel.analog[:] = 0
    panel.push[:] = 0


def _no_number(number: int | None, line: str) -> None:
    if number is not None:
        raise ConfigError(f"{line!r}: there is only one, leave the number out")


def _within(number: int | None, known: range, what: str, line: str) -> int:
    if number is None or number not in known:
        raise ConfigError(f"{line!r}: which {what}? {known.start} to {known.stop - 1}")
    return number


def _level(value: str, line: str) -> int:
    if value not in _LEVELS:
        raise ConfigError(f"{line!r}: on or off?")
    return _LEVELS[value]


def _number(value: str, most: float, unit: str, line: str) -> float:
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not abs(number) <= most:
        raise ConfigError(f"{line!r}: a number from {-most:g} to {most:g} {unit} is needed")
    return number
