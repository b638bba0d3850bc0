"""Object dictionary of the board's CANopen node, as one table; EDS file and documentation page are made from it.

A register of the board is object 0x2000 + its offset, one sub-index for each channel, as a raw word: the rows of
`hwif.registers` say the rest. Where CiA 401 has a place for it, it is there as well. Communication objects are those of
CiA 301; the PDOs are fixed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby
from typing import Final

from qrobot.hwif.canbus.frames import EMCY, RPDO, SYNC, SYNC_COUNTERS, TPDO
from qrobot.hwif.registers import ADC_VALUE, DAC, DISCRETE, ENC_COUNT, ENC_INDEX, N_DACS, REGISTERS, STATUS, Access

I16: Final = 3  # data types: codes of CiA 301, table 44
U8: Final = 5
U16: Final = 6
U32: Final = 7
I64: Final = 0x15
STRING: Final = 9
TYPE_NAMES: Final = {I16: "i16", U8: "u8", U16: "u16", U32: "u32", I64: "i64", STRING: "string"}
_BITS: Final = {I16: 16, U8: 8, U16: 16, U32: 32, I64: 64}

DEVICE_TYPE: Final = 0x000F0191  # CiA 401 with inputs and outputs of both kinds
VENDOR_ID: Final = 0  # we have none

REGISTER_OBJECT: Final = 0x2000
IMAGE_OBJECT: Final = 0x2100
IMAGE_COUNTER, IMAGE_LISTS, IMAGE_COUNT, IMAGE_T_NS = 1, 2, 3, 4
MAILBOX_OBJECT: Final = 0x2101
FACTS_OBJECT: Final = 0x2102
FACTS_REVISION, FACTS_JOINTS, FACTS_PERIOD_NS = 1, 2, 3
COUNTERS_OBJECT: Final = 0x2103
COUNTERS: Final = ("exchanges", "lists thrown away", "frames without meaning", "times the watchdog made it safe")
DIGITAL_IN: Final = 0x6100
DIGITAL_OUT: Final = 0x6300
ANALOG_IN: Final = 0x6401
ANALOG_OUT: Final = 0x6411
PRODUCER_HEARTBEAT: Final = 0x1017
ERROR_REGISTER: Final = 0x1001


@dataclass(frozen=True)
class Entry:
    """One variable: index, sub-index (None: the object is a single variable), type, access, default."""

    index: int
    sub: int | None
    name: str
    kind: int
    access: str
    default: str = ""
    pdo: bool = False


def register_index(offset: int) -> int:
    """Object of the row that begins at byte `offset`."""
    return REGISTER_OBJECT + offset


def _single(index: int, name: str, kind: int, access: str, default: str = "") -> Entry:
    return Entry(index, None, name, kind, access, default)


def _record(index: int, name: str, *members: tuple[str, int, str, str, bool]) -> Iterator[Entry]:
    """An object with sub-indexes; its own name is that of sub-index 0."""
    yield Entry(index, 0, name, U8, "const", str(len(members)))
    for sub, (member, kind, access, default, pdo) in enumerate(members, 1):
        yield Entry(index, sub, member, kind, access, default, pdo)


def _numbers(name: str, kind: int, access: str, count: int) -> list[tuple[str, int, str, str, bool]]:
    return [(f"{name} {channel}" if count > 1 else name, kind, access, "", True) for channel in range(1, count + 1)]


def _registers() -> Iterator[Entry]:
    for row in REGISTERS:
        access = "wo" if row.access is Access.WRITE else "ro"
        yield from _record(register_index(row.offset), row.name, *_numbers(row.name, U16, access, row.count))


def _words(offset: int, first: int, count: int) -> list[int]:
    """Mapping of `count` channels of a row from channel `first` on, from 1 (CiA 301, 7.5.2.36)."""
    return [_mapped(register_index(offset), first + i, U16) for i in range(count)]


def _mapped(index: int, sub: int, kind: int) -> int:
    return index << 16 | sub << 8 | _BITS[kind]


RPDO_MAPS: Final = (
    [_mapped(MAILBOX_OBJECT, sub, U8 if sub < 3 else U16) for sub in range(1, 6)],
    _words(DAC, 1, 4),
    _words(DAC, 5, 4),
    _words(DISCRETE, 1, 1),
)
TPDO_MAPS: Final = (
    [
        _mapped(IMAGE_OBJECT, IMAGE_COUNTER, U8),
        _mapped(IMAGE_OBJECT, IMAGE_LISTS, U8),
        *_words(STATUS, 1, 1),
        _mapped(IMAGE_OBJECT, IMAGE_COUNT, U16),
        *_words(ADC_VALUE, 1, 1),
    ],
    _words(ENC_COUNT, 1, 4),
    [*_words(ENC_COUNT, 5, 2), *_words(ENC_INDEX, 1, 2)],
    _words(ENC_INDEX, 3, 4),
    [_mapped(IMAGE_OBJECT, IMAGE_T_NS, I64)],
)


def _pdos(kind: str, first: int, ids: tuple[int, ...], maps: tuple[list[int], ...]) -> Iterator[Entry]:
    for i, (base, mapped) in enumerate(zip(ids, maps, strict=True)):
        cob_id = ("COB-ID", U32, "const", f"$NODEID+{base:#x}", False)
        sync = ("transmission type", U8, "const", "1", False)
        yield from _record(first + i, f"{kind} {i + 1} parameter", cob_id, sync)
        rows = [(f"mapping {k}", U32, "const", f"{value:#010x}", False) for k, value in enumerate(mapped, 1)]
        yield from _record(first + 0x200 + i, f"{kind} {i + 1} mapping", *rows)


def _board() -> Iterator[Entry]:
    yield from _record(
        IMAGE_OBJECT,
        "image",
        ("counter of the SYNC answered", U8, "ro", "0", True),
        ("lists of operations done", U8, "ro", "0", True),
        ("count of the image", U16, "ro", "0", True),
        ("time stamp, ns", I64, "ro", "0", True),
    )
    words = [(f"value {i}", U16, "wo", "", True) for i in (1, 2, 3)]
    yield from _record(
        MAILBOX_OBJECT,
        "mailbox",
        ("frames to come", U8, "wo", "", True),
        ("offset, writes << 6, first", U8, "wo", "", True),
        *words,
    )
    yield from _record(
        FACTS_OBJECT,
        "facts",
        ("revision, a letter", U8, "ro", "", False),
        ("joints", U8, "ro", "", False),
        ("period of the board, ns", U32, "ro", "", False),
    )
    yield from _record(COUNTERS_OBJECT, "counters", *((name, U32, "ro", "", False) for name in COUNTERS))


def _entries() -> Iterator[Entry]:
    yield _single(0x1000, "device type", U32, "const", f"{DEVICE_TYPE:#010x}")
    yield _single(ERROR_REGISTER, "error register", U8, "ro", "0")
    yield _single(0x1005, "COB-ID SYNC", U32, "const", f"{SYNC:#x}")
    yield _single(0x1008, "device name", STRING, "const", "QRobot board")
    yield _single(0x1014, "COB-ID EMCY", U32, "const", f"$NODEID+{EMCY:#x}")
    yield _single(PRODUCER_HEARTBEAT, "producer heartbeat time, ms", U16, "rw", "0")
    yield from _record(0x1018, "identity", ("vendor", U32, "const", str(VENDOR_ID), False))
    yield _single(0x1019, "synchronous counter overflow", U8, "const", str(SYNC_COUNTERS))
    yield from _pdos("RPDO", 0x1400, RPDO, RPDO_MAPS)
    yield from _pdos("TPDO", 0x1800, TPDO, TPDO_MAPS)
    yield from _registers()
    yield from _board()
    yield from _record(DIGITAL_IN, "read input 16-bit", *_numbers("STATUS", U16, "ro", 1))
    yield from _record(DIGITAL_OUT, "write output 16-bit", *_numbers("DISCRETE", U16, "wo", 1))
    yield from _record(ANALOG_IN, "read analogue input 16-bit", *_numbers("ADC_VALUE", I16, "ro", 1))
    yield from _record(ANALOG_OUT, "write analogue output 16-bit", *_numbers("DAC", I16, "wo", N_DACS))


ENTRIES: Final = tuple(sorted(_entries(), key=lambda entry: (entry.index, entry.sub or 0)))


def eds_text() -> str:
    """The electronic data sheet (CiA 306) of the node."""
    return "\n\n".join([*_eds_head(), *_eds_lists(), *_eds_objects()]) + "\n"


def _section(name: str, **values: str | int) -> str:
    return "\n".join([f"[{name}]", *(f"{key}={value}" for key, value in values.items())])


def _eds_head() -> Iterator[str]:
    yield _section(
        "FileInfo",
        FileName="qrobot_board.eds",
        FileVersion=1,
        FileRevision=0,
        EDSVersion="4.0",
        Description="TRC004 board of QRobot; made from its register map",
    )
    rates = {f"BaudRate_{rate}": 1 for rate in (125, 250, 500, 800, 1000)}
    yield _section(
        "DeviceInfo",
        VendorName="The QRobot developers",
        VendorNumber=VENDOR_ID,
        ProductName="QRobot board",
        SimpleBootUpSlave=1,
        NrOfRXPDO=len(RPDO),
        NrOfTXPDO=len(TPDO),
        LSS_Supported=0,
        **rates,
    )


MANDATORY: Final = (0x1000, 0x1001, 0x1018)


def _eds_lists() -> Iterator[str]:
    indexes = sorted({entry.index for entry in ENTRIES})
    manufacturer = [index for index in indexes if 0x2000 <= index < 0x6000]
    optional = [index for index in indexes if index not in (*MANDATORY, *manufacturer)]
    for name, chosen in (
        ("MandatoryObjects", list(MANDATORY)),
        ("OptionalObjects", optional),
        ("ManufacturerObjects", manufacturer),
    ):
        numbered = {str(i): f"0x{index:04X}" for i, index in enumerate(chosen, 1)}
        yield _section(name, SupportedObjects=len(chosen), **numbered)


def _eds_objects() -> Iterator[str]:
    for index, group in groupby(ENTRIES, key=lambda entry: entry.index):
        entries = list(group)
        if entries[0].sub is None:
            yield _eds_variable(f"{index:04X}", entries[0])
            continue
        yield _section(f"{index:04X}", ParameterName=entries[0].name, ObjectType="0x9", SubNumber=len(entries))
        for entry in entries:
            name = entry.name if entry.sub else "highest sub-index"
            yield _eds_variable(f"{index:04X}sub{entry.sub:X}", entry, name)


def _eds_variable(section: str, entry: Entry, name: str = "") -> str:
    values: dict[str, str | int] = {
        "ParameterName": name or entry.name,
        "ObjectType": "0x7",
        "DataType": f"0x{entry.kind:04X}",
        "AccessType": entry.access,
        "PDOMapping": int(entry.pdo),
    }
    if entry.default:
        values["DefaultValue"] = entry.default
    return _section(section, **values)


def objects_page() -> str:
    """The objects as a table for the documentation."""
    head = "| object | sub | type | access | name | default |\n|---|---|---|---|---|---|\n"
    return head + "".join(
        f"| {entry.index:#06x} | {'-' if entry.sub is None else entry.sub} | {TYPE_NAMES[entry.kind]} | {entry.access} "
        f"| {entry.name} | {f'`{entry.default}`' if entry.default else '-'} |\n"
        for entry in ENTRIES
    )
