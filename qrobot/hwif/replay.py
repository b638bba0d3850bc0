"""Recordings of `recorder.py` read, and played back: in place of the board, or onto another one, access by access."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from qrobot.arrays import Words
from qrobot.errors import (
    LinkError,
    LinkLost,
    LinkTimeout,
    LocalProtocolError,
    LogError,
    RemoteProtocolError,
    error_text,
)
from qrobot.hwif.bus import BoardFacts, Bus, Operations, for_the_transport
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_INPUTS, IMAGE_T_NS, make_image
from qrobot.hwif.operations import OP_ANALOG, OP_FIELDS, OP_OUTPUTS, OP_READ, OP_REFERENCE, OP_WRITE
from qrobot.hwif.recorder import MAGIC, TAKES, changes, operation_text
from qrobot.hwif.registers import N_INPUT_WORDS, register_at

_OPERATION: Final = re.compile(r"(?:([wpoa])([0-9a-f]{2})=(-?[0-9a-f]+)|r([0-9a-f]{2}))\Z")
_KINDS: Final = {"w": OP_WRITE, "p": OP_REFERENCE, "o": OP_OUTPUTS, "a": OP_ANALOG}
_WORD: Final = re.compile(r"([0-9a-f]{2})=([0-9a-f]{1,4})\Z")
_ERRORS: Final = {kind.__name__: kind for kind in (LinkError, LinkLost, LinkTimeout, RemoteProtocolError)}


@dataclass(frozen=True)
class Exchange:
    """One exchange: what was asked, and the image that came back; without one, why none did."""

    line: int
    operations: Operations
    image: Words | None
    error: str = ""


@dataclass(frozen=True)
class BoardFound:
    """The board was found."""

    line: int
    facts: BoardFacts


RecordedEvent = BoardFound | Exchange


@dataclass(frozen=True)
class BusRecording:
    """Contents of a recording.

    Attributes:
        events: connections and exchanges in order.
        torn: the last line is cut off, as after a power cut; it is left out.
    """

    path: Path
    events: tuple[RecordedEvent, ...]
    torn: bool

    @property
    def exchanges(self) -> list[Exchange]:
        """Exchanges in order, those without an image too."""
        return [event for event in self.events if isinstance(event, Exchange)]

    @property
    def duration_s(self) -> float:
        """Board time from the first image to the last."""
        times = [int(each.image[IMAGE_T_NS]) for each in self.exchanges if each.image is not None]
        return (times[-1] - times[0]) * 1e-9 if times else 0.0

    def accesses(self) -> dict[str, int]:
        """Number of writes of each register, or of reads for their side effect, by name."""
        counted: dict[str, int] = {}
        for each in self.exchanges:
            for kind, offset, _ in each.operations.tolist():
                name = operation_name(kind, offset)
                counted[name] = counted.get(name, 0) + 1
        return counted


def operation_name(kind: int, offset: int) -> str:
    """Name of an operation for people."""
    if kind == OP_REFERENCE:
        return f"reference {offset + 1}"
    if kind == OP_ANALOG:
        return f"analogue output {offset + 1}"
    return "outputs" if kind == OP_OUTPUTS else register_name(offset)


def register_name(offset: int) -> str:
    """Name of the register at an offset, with its channel where there are several."""
    try:
        register = register_at(offset)
    except KeyError:
        return f"{offset:#04x}"
    channel = (offset - register.offset) // 2
    return f"{register.name} {channel + 1}" if register.count > 1 else register.name


def load_recording(path: Path) -> BusRecording:
    """Read a recording.

    Raises:
        LogError: no such file, no recording, or a line that means nothing, with its number.
    """
    try:
        text = path.read_text(encoding="ascii")
    except (OSError, UnicodeDecodeError) as error:
        raise LogError(f"cannot read {path}: {error_text(error)}") from None
    *lines, rest = text.split("\n")
    if not lines or lines[0] != MAGIC:
        raise LogError(f"{path} is no recording of registers, or of another version: it does not begin with {MAGIC!r}")
    return BusRecording(path, tuple(_Reader(path).events(lines[1:])), torn=bool(rest))


@dataclass
class _Reader:
    """Lines to events; images are kept from line to line."""

    path: Path
    image: Words = field(default_factory=make_image)

    def events(self, lines: list[str]) -> Iterator[RecordedEvent]:
        for number, line in enumerate(lines, start=2):
            try:
                event = self._event(number, line)
            except (ValueError, IndexError, OverflowError) as error:
                raise LogError(f"{self.path}, line {number}: {error} in {line[:60]!r}") from None
            if event is not None:
                yield event

    def _event(self, number: int, line: str) -> RecordedEvent | None:
        if line == "close":
            return None
        first, *rest = line.split(" ")
        if first == "board":
            self.image = make_image()
            return BoardFound(number, _facts(rest))
        if first == "lost":
            done = [part for part in rest if _OPERATION.match(part)]
            return Exchange(number, _operations(done), None, " ".join(rest[len(done) :]))
        split = rest.index(":")
        return Exchange(number, _operations(rest[1:split]), self._next_image(first, rest[0], rest[split + 1 :]))

    def _next_image(self, t_ns: str, count: str, words: list[str]) -> Words:
        image = self.image.copy()
        image[IMAGE_T_NS] += int(t_ns)
        image[IMAGE_COUNT] += int(count)
        for word in words:
            found = _WORD.match(word)
            if found is None or int(found[1], 16) not in range(0, 2 * N_INPUT_WORDS, 2):
                raise ValueError(f"{word!r} is no input word")
            image[IMAGE_INPUTS + int(found[1], 16) // 2] = int(found[2], 16)
        self.image = image
        return image


def _facts(words: list[str]) -> BoardFacts:
    revision, joints, period_ns, *more = words
    if not set(more) <= set(TAKES):
        raise ValueError(f"{' '.join(more)!r} says nothing of a board")
    if revision not in ("E", "F"):
        raise ValueError(f"no board has revision {revision!r}")
    return BoardFacts(revision, int(joints), int(period_ns), **dict.fromkeys(more, True))


def _operations(words: list[str]) -> Operations:
    rows = []
    for word in words:
        found = _OPERATION.match(word)
        if found is None:
            raise ValueError(f"{word!r} is no operation")
        written, offset, value, read = found.groups()
        rows.append((_KINDS[written], int(offset, 16), int(value, 16)) if written else (OP_READ, int(read, 16), 0))
    return np.array(rows, np.int64).reshape(-1, OP_FIELDS)


class Replay:
    """A recording in place of the board: whoever does what was done then sees what was seen then.

    Raises:
        LogError: as `load_recording`.
    """

    def __init__(self, recording: BusRecording) -> None:
        self._recording, self._next = recording, 0
        self.name = f"the recording {recording.path}"

    @property
    def finished(self) -> bool:
        """Everything has been played."""
        return self._next == len(self._recording.events)

    def connect(self) -> BoardFacts:
        """Raises LocalProtocolError when nobody connected at this point."""
        event = self._take()
        if not isinstance(event, BoardFound):
            raise LocalProtocolError(f"{self._place(event)}: there was an exchange, now somebody connects")
        return event.facts

    def exchange(self, operations: Operations, image: Words) -> None:
        """The image of that time. Raises LocalProtocolError at the first access that differs, and what was raised."""
        event = self._take()
        if not isinstance(event, Exchange):
            raise LocalProtocolError(f"{self._place(event)}: somebody connected, now there is an exchange")
        if difference := operations_differ(event.operations, operations):
            raise LocalProtocolError(f"{self._place(event)}: {difference}")
        if event.image is None:
            kind, _, message = event.error.partition(": ")
            raise _ERRORS.get(kind, LinkError)(message)
        image[:] = event.image

    def close(self) -> None:
        """Do nothing: the recording is in memory."""

    def _take(self) -> RecordedEvent:
        if self.finished:
            raise LocalProtocolError(f"{self._recording.path} ends here, after {self._next} events")
        self._next += 1
        return self._recording.events[self._next - 1]

    def _place(self, event: RecordedEvent) -> str:
        return f"{self._recording.path}, line {event.line}"


def operations_differ(recorded: Operations, now: Operations) -> str:
    """The first access that is not as recorded, in words; "" when all are."""
    for k in range(max(len(recorded), len(now))):
        was = operation_text(*map(int, recorded[k])) if k < len(recorded) else "nothing"
        found = operation_text(*map(int, now[k])) if k < len(now) else "nothing"
        if was != found:
            return f"access {k + 1} was {was}, now it is {found}"
    return ""


def replay_onto(recording: BusRecording, bus: Bus) -> str:
    """Do to `bus` what was done then, and compare the input words that come back.

    Exchanges that failed then are left out: nobody knows how much of them happened.

    Returns:
        The first difference, in words; "" when there is none.

    Raises:
        LinkError, ProtocolError: what the bus raises.
    """
    image, connected, takes_outputs = make_image(), False, False
    for event in recording.events:
        if isinstance(event, BoardFound):
            if not connected:
                takes_outputs = bus.connect().outputs
            connected = True
        elif event.image is not None:
            bus.exchange(event.operations if takes_outputs else for_the_transport(event.operations), image)
            if words := changes(event.image, image):
                was = changes(image, event.image)
                return f"{recording.path}, line {event.line}: was {' '.join(was)}, now it is {' '.join(words)}"
    return ""
