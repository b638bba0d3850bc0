"""The generated parts of docs/reference/wire-protocol.md: tables, C structs, state diagram and hex dump.

A part stands in the page between `<!-- generated: name -->` and `<!-- end -->`; `refresh` rewrites them all, and a test
refuses a page that is not fresh.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import partial
from typing import Final

from qrobot.faultcodes import EXPLANATION
from qrobot.modecodes import Mode
from qrobot.wire import layout
from qrobot.wire.codec import encode
from qrobot.wire.layout import C_TYPES, HEADER_BYTES, HEADER_FIELDS, LAYOUTS, Field, Layout
from qrobot.wire.packets import Command
from qrobot.wire.states import mermaid
from qrobot.wire.vocabulary import ERROR_MEANING, FLAG_MEANING, JointMode, RobotFlag

EXAMPLE: Final = Command(
    seq=258, modes=(JointMode.POSITION, JointMode.HOLD), setpoints=(0.5, 0.0), power=True, stream=1, ack=258, t_ns=1_000
)
"""The worked example: joint 1 of a robot with two joints to 0.5 rad, joint 2 held."""

_PART: Final = re.compile(r"(<!-- generated: ([a-z-]+) -->\n).*?(<!-- end -->)", re.DOTALL)


def refresh(page: str) -> str:
    """The page with every generated part rewritten. Raises KeyError for a part nobody generates."""
    return _PART.sub(lambda found: f"{found[1]}{PARTS[found[2]]().rstrip()}\n{found[3]}", page)


def field_table(shape: Layout) -> str:
    """Offset, type, name, unit and meaning of each field of the payload, as a table."""
    rows = ["| offset | type | field | unit | meaning |", "| --- | --- | --- | --- | --- |"]
    rows += [_row(where, field) for where, field in _places(shape.fields, HEADER_BYTES)]
    return "\n".join(rows)


def header_table() -> str:
    """The same for the header."""
    rows = ["| offset | type | field | unit | meaning |", "| --- | --- | --- | --- | --- |"]
    return "\n".join(rows + [_row(where, field) for where, field in _places(HEADER_FIELDS, 0)])


def _places(fields: tuple[Field, ...], start: int) -> list[tuple[str, Field]]:
    """Each field with its offset, in terms of n behind the first field that is as long as the robot has joints."""
    places, constant, per_joint = [], start, 0
    for field in fields:
        places.append((_offset(constant, per_joint), field))
        constant += field.size * field.length(0)
        per_joint += field.size * (field.count == "n")
    return places


def _offset(constant: int, per_joint: int) -> str:
    return f"{constant} + {per_joint}n" if per_joint else str(constant)


def _row(where: str, field: Field) -> str:
    return f"| {where} | `{_c_type(field)}` | {field.name} | {field.unit} | {field.meaning} |"


def _c_type(field: Field) -> str:
    plain = C_TYPES[field.code]
    if field.count == "rest":
        return f"{plain}[]"
    return plain if field.count == 1 else f"{plain}[{field.count}]"


def packet_table() -> str:
    """All kinds of packets."""
    rows = ["| kind | packet | from | meaning |", "| --- | --- | --- | --- |"]
    return "\n".join(rows + [f"| {each.kind} | {each.name} | {each.sender} | {each.meaning} |" for each in LAYOUTS])


def error_table() -> str:
    """All codes of ERROR."""
    rows = ["| code | name | closes | meaning |", "| --- | --- | --- | --- |"]
    for code, (fatal, meaning) in ERROR_MEANING.items():
        rows.append(f"| {code.value} | {code.name} | {'yes' if fatal else 'no'} | {meaning} |")
    return "\n".join(rows)


def mode_table() -> str:
    """Names and numbers of the modes."""
    rows = ["| number | name |", "| --- | --- |"]
    return "\n".join(rows + [f"| {each.value} | {each.name} |" for each in Mode])


def flag_table() -> str:
    """The bits of `flags`."""
    rows = ["| number | name | meaning |", "| --- | --- | --- |"]
    return "\n".join(rows + [f"| {each.value} | {each.name} | {FLAG_MEANING[each]} |" for each in RobotFlag])


def fault_table() -> str:
    """The codes of `fault` and `event`."""
    rows = ["| code | name | what happened | what to do |", "| --- | --- | --- | --- |"]
    for code, (what, remedy) in sorted(EXPLANATION.items()):
        rows.append(f"| {code.value} | {code.name} | {what} | {remedy} |")
    return "\n".join(rows)


def c_structs() -> str:
    """The packets as C structs for robots of N joints."""
    header = _c_struct("header", [_c_member(field) for field in HEADER_FIELDS])
    packets = [_c_packet(shape) for shape in LAYOUTS]
    return "\n".join(["```c", header, *packets, "```"])


def _c_packet(shape: Layout) -> str:
    members = ["struct qrob_header header;", *map(_c_member, shape.fields)]
    if not any(field.count == "rest" for field in shape.fields):
        members.append("uint32_t crc;")
    return _c_struct(shape.name.lower(), members)


def _c_struct(name: str, members: list[str]) -> str:
    return "\n".join([f"struct qrob_{name} {{", *(f"    {member}" for member in members), "};"])


def _c_member(field: Field) -> str:
    if field.count == "rest":
        return f"/* {C_TYPES[field.code]} {field.name}[], then uint32_t crc */"
    size = "" if field.count == 1 else f"[{'N' if field.count == 'n' else field.count}]"
    return f"{C_TYPES[field.code]} {field.name}{size};"


def state_members(fields: tuple[Field, ...] = layout.STATE.fields) -> Iterator[str]:
    """The members of `struct qrobot_state` for the fields of STATE."""
    for field in fields:
        if field.code != "x":
            size = "" if field.count == 1 else f"[{'QROBOT_MAX_JOINTS' if field.count == 'n' else field.count}]"
            unit = "" if field.unit in ("-", "bits") else f"{field.unit.replace('·', ' ')}: "
            yield f"    {_plain_type(field)} {field.name}{size}; /* {unit}{field.meaning} */"


def state_reads(fields: tuple[Field, ...] = layout.STATE.fields) -> Iterator[str]:
    """The statements that take the fields of STATE, at their places, out of a frame."""
    moving = False
    for field in fields:
        place = f"frame + QROBOT_AT_STATE_{field.name.upper()}{'(n)' if moving else ''}"
        moving = moving or field.count == "n"
        if field.code == "d":
            target = f"&state->{field.name}" if field.count == 1 else f"state->{field.name}"
            yield f"    qrw_get_doubles({place}, {field.count}, {target});"
        elif field.code != "x":
            cast = "int16_t" if field.code == "h" else _plain_type(field)
            yield f"    state->{field.name} = ({cast})qrw_get({place}, {field.size});"


def _plain_type(field: Field) -> str:
    if field.code == "d":
        return "double"
    return "uint32_t" if field.code == "I" or field.unit == "bits" else "int"


def hex_dump() -> str:
    """The worked example, one field per line."""
    data, n = encode(EXAMPLE), EXAMPLE.n
    lines = ["```text"]
    end = 0
    for offset, field in layout.COMMAND.rows(n):
        end = offset + field.size * field.length(n)
        lines += [_dump_line(data, at, min(at + 16, end), field.name) for at in range(offset, end, 16)]
    if end < len(data) - layout.CRC_BYTES:
        lines.append(_dump_line(data, end, len(data) - layout.CRC_BYTES, "padding"))
    return "\n".join([*lines, _dump_line(data, len(data) - layout.CRC_BYTES, len(data), "crc"), "```"])


def _dump_line(data: bytes, start: int, end: int, name: str) -> str:
    return f"{start:3d}  {data[start:end].hex(' '):<47s}  {name}"


PARTS: Final[dict[str, Callable[[], str]]] = {
    "packets": packet_table,
    "header": header_table,
    "states": lambda: f"```mermaid\n{mermaid()}```",
    "errors": error_table,
    "faults": fault_table,
    "modes": mode_table,
    "flags": flag_table,
    "structs": c_structs,
    "dump": hex_dump,
    **{shape.name.lower(): partial(field_table, shape) for shape in LAYOUTS},
}
