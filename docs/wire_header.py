"""The generated part of the C header: every number of the wire protocol, from the tables that the codec uses."""

from __future__ import annotations

import re
from collections.abc import Iterator
from enum import IntEnum
from textwrap import fill
from typing import Final

from qrobot.faultcodes import EXPLANATION, NO_JOINT
from qrobot.modecodes import Mode
from qrobot.wire import layout, vocabulary
from qrobot.wire.document import state_members, state_reads
from qrobot.wire.layout import CRC_BYTES, HEADER_BYTES, HEADER_FIELDS, LAYOUTS, Field, Layout

_PART: Final = re.compile(r"(/\* generated: (\w+) \*/\n).*?( */\* end \*/)", re.DOTALL)
_ENUMERATIONS: Final = {
    "ROLE": vocabulary.ClientRole,
    "JOINT": vocabulary.JointMode,
    "HAND": vocabulary.Hand,
    "REACTION": vocabulary.CollisionReaction,
    "MODE": Mode,
    "HELLO_FLAG": vocabulary.HelloFlag,
    "FLAG": vocabulary.RobotFlag,
    "REQUEST": vocabulary.Request,
    "ERROR": vocabulary.ErrorCode,
}
_LIMITS: Final = {
    "VERSION": vocabulary.VERSION,
    "DEFAULT_PORT": vocabulary.DEFAULT_PORT,
    "MAX_JOINTS": vocabulary.MAX_JOINTS,
    "NO_JOINT": NO_JOINT,
    "SHORTEST_PERIOD_US": vocabulary.SHORTEST_PERIOD_US,
    "LONGEST_PERIOD_US": vocabulary.LONGEST_PERIOD_US,
    "LARGEST_SETPOINT": vocabulary.LARGEST_SETPOINT,
    "SIGNALS": vocabulary.N_SIGNALS,
    "ANALOG_OUTPUTS": vocabulary.N_ANALOG_OUTPUTS,
    "LONGEST_SIGNAL": vocabulary.LONGEST_SIGNAL,
    "MAX_PACKET": layout.MAX_PACKET_BYTES,
    "HEADER_BYTES": HEADER_BYTES,
    "NAME_BYTES": layout.NAME_BYTES,
}


def refresh(header: str) -> str:
    """The header with its generated parts made anew."""
    return _PART.sub(lambda found: found[1] + "\n".join(_PARTS[found[2]]()) + "\n" + found[3], header)


def _constants() -> Iterator[str]:
    yield f'#define QROBOT_MAGIC "{layout.MAGIC.decode()}"'
    yield from (f"#define QROBOT_{name} {value:g}" for name, value in _LIMITS.items())
    yield ""
    yield _enumeration("KIND", {shape.name: shape.kind for shape in LAYOUTS})
    yield from (_enumeration(name, _members(numbers)) for name, numbers in _ENUMERATIONS.items())
    yield "\n/* Where the fields lie; n joints. */"
    yield from _offsets("", HEADER_FIELDS, 0)
    for shape in LAYOUTS:
        yield from _offsets(f"{shape.name}_", shape.fields, HEADER_BYTES)
        yield _size(shape)
    yield "\n" + _fault_texts()


def _members(numbers: type[IntEnum]) -> dict[str, int]:
    return {each.name: each.value for each in numbers}


def _enumeration(name: str, members: dict[str, int]) -> str:
    tied = (f"QROBOT_{name}_{member}\0=\0{number}" for member, number in members.items())  # not to be torn apart
    text = fill(", ".join(tied), 116, initial_indent="    ", subsequent_indent="    ")
    return f"enum {{\n{text}\n}};".replace("\0", " ")


def _offsets(prefix: str, fields: tuple[Field, ...], start: int) -> list[str]:
    """Each field at its offset; behind the first field with one number per joint that depends on n."""
    constant, per_joint = start, 0
    fixed, moving = dict[str, int](), list[str]()
    for field in fields:
        name = f"{prefix}{field.name.upper()}"
        if field.name not in ("reserved", "magic") and not per_joint:
            fixed[name] = constant
        elif per_joint:
            moving.append(f"#define QROBOT_AT_{name}(n) ({constant} + {per_joint} * (size_t)(n))")
        constant += field.size * field.length(0)
        per_joint += field.size * (field.count == "n")
    return [_enumeration("AT", fixed), *moving]


def _size(shape: Layout) -> str:
    """Bytes of a packet without a rest; what depends on n is padded as the layout pads it."""
    per_joint = sum(field.size for field in shape.fields if field.count == "n")
    if not per_joint:
        return f"#define QROBOT_{shape.name}_BYTES {shape.size(0)}"
    constant = shape.size(0) - CRC_BYTES
    return f"#define QROBOT_{shape.name}_BYTES(n) (({constant} + {per_joint} * (size_t)(n) + 3) / 4 * 4 + {CRC_BYTES})"


def _fault_texts() -> str:
    lines = ["/* What a fault or an event is, for people. */"]
    lines += ["static inline const char *qrobot_fault_text(int code)", "{", "    switch (code) {"]
    lines += [
        f'    case {code.value}: return "{code.name}: {what}";' for code, (what, _) in sorted(EXPLANATION.items())
    ]
    return "\n".join([*lines, '    default: return "a code that is not known here";', "    }", "}"])


_PARTS: Final = {"constants": _constants, "state": state_members, "decode": state_reads}
