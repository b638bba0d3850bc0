"""A stream for people: `unstream` of the paper. A line for each record, with what the common ones say."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from qrobot.arcl.events import ArclEvent, Grip
from qrobot.arcl.stream.layout import RecordKind
from qrobot.arcl.stream.reader import Stream, StreamRecord
from qrobot.model.orientation import rpy_angles
from qrobot.units import DEG_PER_RAD, MM_PER_M


def stream_lines(stream: Stream) -> Iterator[str]:
    """Lines of text: degrees, millimetres, seconds."""
    start = stream.start
    yield f"robot {start.robot}, structure {start.structure}, program {start.program}, machine {start.machine}, " \
        f"dT={start.period_us / 1e3:g}"  # fmt: skip
    for record in stream.records:
        yield f"{record.t_ms / 1e3:10.3f}  {_name(record.kind):<10}{_said(stream, record)}".rstrip()
    if stream.damage:
        yield f"incomplete: {stream.damage}"


def _name(kind: int) -> str:
    try:
        return RecordKind(kind).name.lower()
    except ValueError:
        return f"kind {kind}"


def _said(stream: Stream, record: StreamRecord) -> str:
    say = _SAYINGS.get(record.kind)
    return f"{len(record.content)} bytes" if say is None else say(stream, record)


def _joints(stream: Stream, record: StreamRecord) -> str:
    scales = np.array([MM_PER_M if kind == "P" else DEG_PER_RAD for kind in stream.start.structure])
    return " ".join(f"{number:10.4f}" for number in record.numbers * scales)


def _pose(_stream: Stream, record: StreamRecord) -> str:
    columns = record.numbers.reshape(4, 3).T
    p, angles = columns[:, 3] * MM_PER_M, np.array(rpy_angles(columns[:, :3])) * DEG_PER_RAD
    x, y, z, r, b, w = [*p, *angles]
    return f"x:{x:.3f} y:{y:.3f} z:{z:.3f} RPY r:{r:.3f} p:{b:.3f} y:{w:.3f}"


def _gripper(_stream: Stream, record: StreamRecord) -> str:
    command, value = record.numbers
    name = Grip(int(command)).name if int(command) in set(Grip) else f"command {command:.0f}"
    return f"{name} {value:g}" if value else name


def _event(_stream: Stream, record: StreamRecord) -> str:
    number = int(np.frombuffer(record.content[:8], dtype="<f8")[0])
    name = ArclEvent(number).name if number in set(ArclEvent) else f"event {number}"
    return f"{name} {record.content[8:].decode(errors='replace')}"


def _outputs(_stream: Stream, record: StreamRecord) -> str:
    first, count, value = record.numbers
    return f"lines {first:.0f} to {first + count - 1:.0f} are {value:.0f}"


def _analog(_stream: Stream, record: StreamRecord) -> str:
    output, volts = record.numbers
    return f"analogue output {output:.0f} is {volts:g} V"


def _text(_stream: Stream, record: StreamRecord) -> str:
    return record.text


def _nothing(_stream: Stream, _record: StreamRecord) -> str:
    return ""


_SAYINGS: Final[dict[int, Callable[[Stream, StreamRecord], str]]] = {
    RecordKind.JOINTS: _joints,
    RecordKind.MEASURED: _joints,
    RecordKind.CARTESIAN: _pose,
    RecordKind.REQUEST: _text,
    RecordKind.EXEC: _text,
    RecordKind.ERROR: _text,
    RecordKind.GRIPPER: _gripper,
    RecordKind.OUTPUT: _outputs,
    RecordKind.ANALOG: _analog,
    RecordKind.EVENT: _event,
    RecordKind.END: _nothing,
}
