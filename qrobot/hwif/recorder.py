"""Every access of a bus, written down: which registers were written and read, in which order, and what came back.

A recording is text, a line to an exchange, each written whole at once: what is on the disk after a power cut is
complete up to the last line. No exchange waits for the disk: a thread of its own writes the lines.

    qrobot-registers 1
    board F 6 250000                                   revision, joints, ns between images; again when reconnected;
                                                       `references` and `outputs` behind it when it takes them
    4000000 17 w30=800 w2e=47 r1e : 0c=8041 10=fff0    ns and images since the line before; operations; changed words
    lost w30=7ff LinkLost: nobody answers              an exchange that failed
    close

Offsets and values are hexadecimal. Operations are `w` (write), `r` (a read for its side effect), `p` (where a joint's
motor is to be), `o` (outputs of the arm) and `a` (an analogue output, microvolts); input words are those that differ
from the image before. `replay.py` reads it.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from pathlib import Path
from queue import SimpleQueue
from types import TracebackType
from typing import Final, TextIO

from qrobot.arrays import Words
from qrobot.errors import LinkError, LogError, ProtocolError
from qrobot.hwif.bus import BoardFacts, Bus, Operations
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_INPUTS, IMAGE_T_NS, make_image
from qrobot.hwif.operations import OP_ANALOG, OP_OUTPUTS, OP_READ, OP_REFERENCE, OP_WRITE
from qrobot.hwif.registers import N_INPUT_WORDS

MAGIC: Final = "qrobot-registers 1"
LETTERS: Final = {OP_WRITE: "w", OP_READ: "r", OP_REFERENCE: "p", OP_OUTPUTS: "o", OP_ANALOG: "a"}
TAKES: Final = ("references", "outputs")  # what a board may take besides: facts of that name
KEPT_LINES: Final = 100_000  # [A] that wait for the disk: 25 s of a bus at 4 kHz


class BusRecorder:
    """A bus that writes down what goes over another one.

    Args:
        bus: the one that does the work.
        path: file to write; an old one is replaced.
        begin: called first in the thread that writes. It is to have the priority of the one that exchanges, which waits
            for it at the interpreter's lock.

    Attributes:
        problem: why the recording ended before its time, a full or a slow disk say; the bus goes on working. "" while
            it goes on, and when all was written in the end.

    Raises:
        LogError: the file cannot be written.
    """

    def __init__(self, bus: Bus, path: Path, begin: Callable[[], object] = lambda: None) -> None:
        self._bus, self._begin = bus, begin
        self._before = make_image()
        self.problem = ""
        try:
            self._file: TextIO = path.open("w", buffering=1, encoding="ascii", errors="backslashreplace")
        except OSError as error:
            raise LogError(f"cannot record to {path}: {error.strerror}") from None
        self._lines = SimpleQueue[str | None]()
        self._writer = threading.Thread(target=self._write, name="recorder", daemon=True)
        self._writer.start()
        self._note(MAGIC)

    @property
    def name(self) -> str:
        """Name of the bus."""
        return self._bus.name

    def connect(self) -> BoardFacts:
        """Connect the bus. Raises what it raises."""
        facts = self._bus.connect()
        self._before[:] = 0
        takes = (name for name in TAKES if getattr(facts, name))
        self._note(" ".join(["board", facts.revision, str(facts.joints), str(facts.period_ns), *takes]))
        return facts

    def exchange(self, operations: Operations, image: Words) -> None:
        """Exchange over the bus, and write it down. Raises what the bus raises."""
        done = " ".join(operation_text(*map(int, row)) for row in operations)
        try:
            self._bus.exchange(operations, image)
        except (LinkError, ProtocolError) as error:
            self._note(f"lost {done}{' ' if done else ''}{type(error).__name__}: {' '.join(str(error).split())}")
            raise
        t_ns = int(image[IMAGE_T_NS] - self._before[IMAGE_T_NS])
        count = int(image[IMAGE_COUNT] - self._before[IMAGE_COUNT])
        self._note(" ".join([str(t_ns), str(count), *([done] if done else []), ":", *changes(self._before, image)]))
        self._before[:] = image

    def close(self) -> None:
        """Let go of the board; the file stays open for the next connection."""
        self._bus.close()
        self._note("close")

    def finish(self) -> None:
        """Wait until the disk has all lines, and close the file."""
        self._lines.put(None)
        self._writer.join()
        with contextlib.suppress(OSError):  # what could not be written is the problem already
            self._file.close()

    def __enter__(self) -> BusRecorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.finish()

    def _note(self, line: str) -> None:
        """Let a line be written, unless the recording has ended: one with a gap could not be replayed."""
        if self.problem:
            return
        if self._lines.qsize() < KEPT_LINES:
            self._lines.put(line)
        else:
            self.problem = "the disk is slower than the bus"

    def _write(self) -> None:
        self._begin()
        try:
            while (line := self._lines.get()) is not None:
                self._file.write(f"{line}\n")
        except (OSError, ValueError) as error:
            self.problem = str(error)


def operation_text(kind: int, offset: int, value: int) -> str:
    """One operation as it stands in a recording."""
    written = "" if kind == OP_READ else f"={value:x}"
    return f"{LETTERS.get(kind, '?')}{offset:02x}{written}"


def changes(before: Words, image: Words) -> list[str]:
    """The input words of `image` that differ from those of `before`."""
    words = range(IMAGE_INPUTS, IMAGE_INPUTS + N_INPUT_WORDS)
    return [f"{2 * (k - IMAGE_INPUTS):02x}={int(image[k]):x}" for k in words if image[k] != before[k]]
