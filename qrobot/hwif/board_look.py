"""A look at a board for people: each register with its word and what that says, each bit by its name. Only read."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np

from qrobot.config.deployment import BoardChoice
from qrobot.hwif import registers as reg
from qrobot.hwif.board_memory import PANEL_MICRO, BoardMemory
from qrobot.hwif.bus import MemoryEndpoint
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_INPUTS, IMAGE_STATUS, IMAGE_T_NS, make_image
from qrobot.hwif.registers import REGISTERS, Access, Register
from qrobot.hwif.trace import load_head, read_trace
from qrobot.units import NS_PER_MS

_SIGN: Final = 0x8000
_STATUS_BITS: Final = {
    15: "arm power is on",
    14: "converter is busy",
    **{8 + j: f"index of joint {j + 1} armed, not seen" for j in range(6)},
    7: "joint 6 overflow",
    6: "calibrated",
    **{k: f"input {k}" for k in range(5, 0, -1)},
    0: "emergency stop chain is closed",
}
_DISCRETE_BITS: Final = {
    0: "arm power enable",
    1: "hand open, active low",
    2: "hand close, active low",
    **{k: f"line {k}" for k in range(3, 6)},
    6: "calibrated",
    7: "joint 6 overflow",
    **{8 + j: f"index latch of joint {j + 1} armed" for j in range(6)},
    14: "converter enabled",
}


@dataclass(frozen=True)
class RegisterLook:
    """One register as it is.

    Attributes:
        name: with the number of the channel, from 1, where there are several.
        offset: byte offset.
        word: as read, or as last written; None: it was not written since the board started.
        told: in its unit.
    """

    name: str
    offset: int
    word: int | None
    told: str


@dataclass(frozen=True)
class BitLook:
    """One bit of STATUS or DISCRETE."""

    register: str
    bit: int
    name: str
    on: bool


class BoardLooker:
    """Looks at the board memory of an arm, of this process or a mapped one.

    Args:
        memory: the board memory.
        choice: the board of the deployment, for what stands beside it.
    """

    def __init__(self, memory: BoardMemory, choice: BoardChoice) -> None:
        self._memory, self._choice = memory, choice
        self._written: dict[int, int] = {}
        self._next = 0

    def look(self) -> dict[str, Any]:
        """Everything there is to see, plain values for JSON. Raises LinkError: the board shows no image."""
        memory, image = self._memory, make_image()
        MemoryEndpoint(memory).read_image(image)
        self._follow_writes()
        facts, status = memory.facts, int(image[IMAGE_STATUS])
        return {
            "count": int(image[IMAGE_COUNT]),
            "t_s": int(image[IMAGE_T_NS]) * 1e-9,
            "period_ms": int(facts.period_ns) / NS_PER_MS,
            "revision": chr(int(facts.revision)),
            "emulated": bool(facts.now_ns),
            "registers": [asdict(each) for each in self._registers(image)],
            "bits": [asdict(each) for each in self._bits(status)],
            "modules": self._modules(status),
            "counters": self._counters(),
        }

    def _registers(self, image: np.ndarray[Any, Any]) -> list[RegisterLook]:
        made = []
        for row in REGISTERS:
            for channel, offset in enumerate(row.offsets, 1):
                if row.access is Access.READ:
                    word: int | None = int(image[IMAGE_INPUTS + offset // 2])
                elif offset in range(reg.DAC, reg.DAC + 2 * reg.N_DACS, 2) or offset == reg.DISCRETE:
                    word = self._written.get(offset)
                else:
                    continue
                name = row.name if row.count == 1 else f"{row.name} {channel}"
                told = "not written yet" if word is None else _told(row, word, chr(int(self._memory.facts.revision)))
                made.append(RegisterLook(name, offset, word, told))
        return made

    def _bits(self, status: int) -> list[BitLook]:
        made = [BitLook("STATUS", bit, name, bool(status >> bit & 1)) for bit, name in _STATUS_BITS.items()]
        if (discrete := self._written.get(reg.DISCRETE)) is not None:
            made += [BitLook("DISCRETE", bit, name, bool(discrete >> bit & 1)) for bit, name in _DISCRETE_BITS.items()]
        return made

    def _counters(self) -> dict[str, float]:
        facts = self._memory.facts
        return {
            "operations without meaning": int(facts.illegal_ops),
            "operations dropped": int(facts.dropped),
            "times the board was lost": int(facts.losses),
            "times a module was lost": int(facts.module_losses),
            "periods skipped": int(facts.skipped),
            "ms that time stood still": int(facts.slipped_ns) / NS_PER_MS,
        }

    def _modules(self, status: int) -> list[dict[str, Any]]:
        """Remote modules beside the board, and what is seen of their lines."""
        choice, panel = self._choice, self._memory.panel
        emulated = bool(self._memory.facts.now_ns)
        made = []
        for module in choice.io:
            lines = [f"input {each.input}: {_on(status >> each.input & 1)}" for each in module.inputs]
            for analog in module.analog:
                volt = f": {panel.analog[analog.channel] / PANEL_MICRO:.3f} V" if emulated else ""
                lines.append(f"channel {analog.channel}{volt}")
            for output in module.outputs:
                state = f": {_on(int(panel.outputs) >> output.output - 1 & 1)}" if emulated else ""
                lines.append(f"output {output.output}, {output.label}{state}")
            lines += ["gripper that follows the hand"] if module.gripper else []
            made.append({"name": f"Modbus {module.host}:{module.port}, device {module.device_id}", "lines": lines})
        if (sensor := choice.can_sensor) is not None:
            lines = [f"channel {each.channel}: frame {each.id:#x}" for each in sensor.signals]
            made.append({"name": f"CAN {sensor.interface}:{sensor.channel}", "lines": lines})
        return made

    def _follow_writes(self) -> None:
        """Keep the newest write of each register that cannot be read."""
        head = int(load_head(self._memory))
        rows = read_trace(self._memory, self._next)
        self._next = head
        for offset in np.unique(rows[:, 2]):
            self._written[int(offset)] = int(rows[rows[:, 2] == offset][-1, 3])


def _told(row: Register, word: int, revision: str) -> str:
    match row.name:
        case "ENC_INDEX" | "ENC_COUNT":
            return f"{_signed(word)} counts"
        case "ADC_VALUE" if revision == "F":
            return f"{_signed(word & reg.ADC_F_MASK) * reg.ADC_F_VOLT_PER_COUNT:.3f} V"
        case "ADC_VALUE":
            return f"{(word & 0xFF) * reg.ADC_E_VOLT_PER_COUNT:.3f} V"
        case "DAC":
            return f"{(reg.DAC_ZERO - (word & reg.DAC_MASK)) / reg.DAC_COUNTS_PER_VOLT:+.3f} V"
        case _:
            return f"{word:016b}"


def _signed(word: int) -> int:
    return (word & 0xFFFF ^ _SIGN) - _SIGN


def _on(level: int) -> str:
    return "on" if level else "off"
