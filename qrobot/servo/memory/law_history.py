"""The journal: which law with which gains has been in force since when, in servo memory, for whoever keeps a log.

A telemetry row has no room for names. So the servo's main thread adds an entry at its start, after every swap, for
other names of a program's numbers, and when the law before is back, to a small ring of the same kind as the rows'
(`servo.memory.telemetry`), with the tick of the first cycle the loop ran under it. Names and a law that is back are
seen by the main thread a little later than by the loop.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from qrobot.arrays import Words
from qrobot.printable import printable
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.memory.settings_text import SETTINGS_BYTES
from qrobot.servo.memory.telemetry import append_row, copy_rows, head_row, oldest_row, ring_words

ENTRIES: Final = 64  # a power of two; the oldest gives way
LAW_BYTES: Final = 64
SIGNALS_BYTES: Final = 256


@dataclass(frozen=True)
class LawInForce:
    """A law and its gains, from a cycle on until the next entry.

    Attributes:
        t_ns, tick: planned time and number of the first cycle; both 0 for what a servo started with.
        law: its name. settings: those of the law itself, such as "frequency=8 damping=1"; see `settings_text`.
        kp, kv, inertia: gains, SI units. Shape (n,).
        signals: names of its numbers in the rows, in their order, such as "pressed advance".
        program_signals: names of the program's numbers, likewise.
    """

    t_ns: int
    tick: int
    law: str
    settings: str
    kp: tuple[float, ...]
    kv: tuple[float, ...]
    inertia: tuple[float, ...]
    signals: str = ""
    program_signals: str = ""

    @property
    def told(self) -> str:
        """Law and settings, for people."""
        return f"{self.law} ({self.settings})" if self.settings else self.law


def journal_words(n: int) -> int:
    """Size of the journal of a servo of `n` joints, in words."""
    return ring_words(entry_words(n), ENTRIES)


def write_entry(words: Words, base: int, entry: LawInForce) -> None:
    """Servo's main thread: add an entry to the journal at `base`."""
    record = np.zeros(1, dtype=entry_dtype(len(entry.kp)))
    record["t_ns"], record["tick"] = entry.t_ns, entry.tick
    record["law"], record["settings"] = entry.law.encode(), entry.settings.encode()
    record["signals"], record["program_signals"] = entry.signals.encode(), entry.program_signals.encode()
    record["kp"], record["kv"], record["inertia"] = entry.kp, entry.kv, entry.inertia
    row = record.view(np.int64)
    append_row(words, base, ENTRIES, row.size, row)


class JournalReader:
    """Follows the journal at `base` of the servo memory of `n` joints; each reader keeps its own place."""

    def __init__(self, words: Words, base: int, n: int) -> None:
        self._words, self._base, self._dtype = words, base, entry_dtype(n)
        self._rows = np.zeros((ENTRIES, entry_words(n)), dtype=np.int64)
        self._next = int(oldest_row(int(head_row(words, base)), ENTRIES))

    def read(self) -> Iterator[LawInForce]:
        """Entries since the last call, oldest first."""
        copied, lost = copy_rows(self._words, self._base, ENTRIES, self._rows.shape[1], self._next, self._rows)
        self._next += copied + lost
        for record in self._rows[:copied].copy().view(self._dtype)[:, 0]:
            t_ns, tick, *texts, kp, kv, inertia = record.tolist()
            law, settings, signals, program = (printable(text.decode(errors="replace")) for text in texts)
            yield LawInForce(t_ns, tick, law, settings, tuple(kp), tuple(kv), tuple(inertia), signals, program)


def entry_dtype(n: int) -> np.dtype[Any]:
    """NumPy record of one entry of a servo of `n` joints."""
    gains = [(name, "<f8", (n,)) for name in ("kp", "kv", "inertia")]
    sizes = {"law": LAW_BYTES, "settings": SETTINGS_BYTES, "signals": SIGNALS_BYTES, "program_signals": SIGNALS_BYTES}
    texts = [(name, f"S{size}") for name, size in sizes.items()]
    return np.dtype([("t_ns", "<i8"), ("tick", "<i8"), *texts, *gains])


@lean_kernel
def entry_words(n: int) -> int:
    """Words of one entry of a servo of `n` joints: time and tick, four texts, three gains a joint."""
    return 2 + (LAW_BYTES + SETTINGS_BYTES + 2 * SIGNALS_BYTES) // 8 + 3 * n
