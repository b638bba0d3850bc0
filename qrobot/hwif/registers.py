"""Register map of the TRC004 board behind a TRC006 card: 64 bytes of I/O space, 16-bit words at even offsets.

Source documents: the board vendor's published C driver, version 4.3 (tag V: offsets, masks, access sequences), the
QRobot paper, section 5 (tag Q: channel counts, the 64-byte window), access sequences read as a specification (tag I),
and our own choice for the emulator where no source speaks (tag A).

Reads live at 0x00-0x1E and writes at 0x20-0x3E; no offset is used in both directions [V]. Everything else in this
package, the emulated board and the documentation page derive from the rows below.
"""
# ruff: noqa: E501 (a table reads best one row to a line)

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final

N_ENCODERS: Final = 6
N_DACS: Final = 8
N_ADCS: Final = 8
WINDOW_BYTES: Final = 0x40
N_INPUT_WORDS: Final = 16


class Access(Enum):
    """Use of a register."""

    READ = "read"
    READ_TRIGGERS = "read, and reading acts"
    WRITE = "write"


@dataclass(frozen=True)
class Register:
    """One row: `count` registers at `offset`, `offset + 2`, ..."""

    offset: int
    name: str
    count: int
    width: int
    access: Access
    scale: str
    unit: str
    meaning: str
    source: str

    @property
    def offsets(self) -> range:
        """Byte offsets of all channels of this row."""
        return range(self.offset, self.offset + 2 * self.count, 2)


REGISTERS: Final[tuple[Register, ...]] = (
    Register(0x00, "ENC_INDEX", 6, 16, Access.READ, "1", "count", "count latched at the last index pulse; no side effect", "V, I"),
    Register(0x0C, "STATUS", 1, 16, Access.READ, "bits", "-", "see STATUS bits; no side effect", "V"),
    Register(0x10, "ENC_COUNT", 6, 16, Access.READ, "1", "count", "live quadrature count, wraps modulo 65536; joint 6 at half rate since rev E", "V"),
    Register(0x1C, "ADC_VALUE", 1, 16, Access.READ, "rev F: 20/65536 of & 0xFFF0, two's complement; rev E: 5/255 of the low byte", "V", "last conversion", "V"),
    Register(0x1E, "ADC_START", 1, 8, Access.READ_TRIGGERS, "-", "-", "rev E: reading starts a conversion, the value means nothing; rev F: unused", "V"),
    Register(0x20, "ENC_LOAD", 6, 16, Access.WRITE, "1", "count", "presets the counter at once; the index latch stays", "V, I"),
    Register(0x2C, "ADC_MUX", 1, 16, Access.WRITE, "rev F: (channel << 7) | 0x50; rev E: channel", "-", "selects the channel; rev F: also starts", "V"),
    Register(0x2E, "DISCRETE", 1, 16, Access.WRITE, "bits", "-", "see DISCRETE bits; not readable, the driver keeps a shadow", "V"),
    Register(0x30, "DAC", 8, 16, Access.WRITE, "(0x800 - n) / 204.8", "V", "12-bit offset binary, inverted; 0 is full torque, 0x800 is zero; 0-5 joints, 6-7 spare", "V"),
)  # fmt: skip

ENC_INDEX: Final = 0x00
STATUS: Final = 0x0C
ENC_COUNT: Final = 0x10
ADC_VALUE: Final = 0x1C
ADC_START: Final = 0x1E
ENC_LOAD: Final = 0x20
ADC_MUX: Final = 0x2C
DISCRETE: Final = 0x2E
DAC: Final = 0x30

# STATUS bits [V]
STATUS_POWER: Final = 0x8000  # 1: arm power is on
STATUS_ADC_BUSY: Final = 0x4000  # 1: armed, not done; 0: done
STATUS_INDEX: Final = 0x3F00  # per joint, J1 = 0x0100: 1 armed and none seen, 0 index seen
STATUS_J6_OVERFLOW: Final = 0x0080  # readback of DISCRETE bit 7 [I]
STATUS_CALIBRATED: Final = 0x0040  # readback of DISCRETE bit 6 [V]
STATUS_INPUTS: Final = 0x003F  # the six discrete inputs [I]
STATUS_ESTOP_OK: Final = 0x0001  # discrete input 0: emergency stop chain healthy [A]

# DISCRETE bits [V]
DISCRETE_POWER: Final = 0x0001  # 1: arm power enable
DISCRETE_HAND_OPEN: Final = 0x0002  # solenoid, active low
DISCRETE_HAND_CLOSE: Final = 0x0004  # solenoid, active low
DISCRETE_LINES: Final = 0x0038  # bits 3 to 5, unused by the driver [V]; which of 0 to 7 have drivers is not known [Q]
DISCRETE_CALIBRATED: Final = 0x0040  # host scratch bit, survives the host
DISCRETE_J6_OVERFLOW: Final = 0x0080  # host scratch bit
SCRATCH_BITS: Final = DISCRETE_CALIBRATED | DISCRETE_J6_OVERFLOW  # STATUS shows them in the same places [I]
DISCRETE_INDEX: Final = 0x3F00  # per joint: 0 presets the latch, 1 arms it (STATUS bit 1)
DISCRETE_ADC: Final = 0x4000  # enables the ADC-done flip-flop
DISCRETE_HAND_RELAXED: Final = DISCRETE_HAND_OPEN | DISCRETE_HAND_CLOSE

INDEX_BIT_0: Final = 0x0100  # joint 1's bit in STATUS_INDEX and DISCRETE_INDEX

# DAC coding [V]: the all-zero word is +10 V, full torque; zero torque has to be written
DAC_ZERO: Final = 0x800
DAC_MASK: Final = 0xFFF
DAC_COUNTS_PER_VOLT: Final = 204.8

# ADC coding [V]
ADC_F_COMMAND: Final = 0x50
ADC_F_CHANNEL_SHIFT: Final = 7
ADC_F_MASK: Final = 0xFFF0
ADC_F_VOLT_PER_COUNT: Final = 20.0 / 65536.0
ADC_E_VOLT_PER_COUNT: Final = 5.0 / 255.0


def register_at(offset: int) -> Register:
    """The row that owns byte `offset`. Raises KeyError for an offset no row uses."""
    for register in REGISTERS:
        if offset in register.offsets:
            return register
    raise KeyError(f"no register at offset {offset:#04x}")


def markdown_table() -> str:
    """Table of the register page, which `docs/refresh.py` writes there."""
    head = "| offset | n | bits | name | access | scale | unit | meaning | source |\n|---|---|---|---|---|---|---|---|---|\n"
    return head + "".join(
        f"| {r.offset:#04x} | {r.count} | {r.width} | {r.name} | {r.access.value} | {r.scale.replace('|', chr(92) + '|')} "
        f"| {r.unit} | {r.meaning} | {r.source} |\n"
        for r in REGISTERS
    )
