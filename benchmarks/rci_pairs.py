"""Two tasks of RCI on processors of their own: what a message, and a word of shared memory, takes between them.

The functions stand in a module, where the processes find them by name.
"""

from __future__ import annotations

import time
from typing import Final

import numpy as np
from numpy.typing import NDArray

from qrobot import rci

RATE_HZ: Final = 1000
PERIOD: Final = 5  # ticks
LOOK_NS: Final = 3_500_000  # of each period; the other task speaks in the middle
WORD, DONE, FIRST = 0, 1, 2  # words of "seen": what is posted, how many were noted, the first of them


def seen() -> NDArray[np.int64]:
    """Words that both tasks reach."""
    return rci.rci_get_memory("seen").view(np.int64)


def tell(_td: rci.TaskDescriptor) -> None:
    """Send the instant as a message."""
    rci.rci_send(rci.rci_descriptor("look").bit, time.monotonic_ns().to_bytes(8, "little"))


def post(_td: rci.TaskDescriptor) -> None:
    """Write the instant into shared memory."""
    seen()[WORD] = time.monotonic_ns()


def hear(_td: rci.TaskDescriptor) -> None:
    """Look for messages."""
    until = time.monotonic_ns() + LOOK_NS
    while time.monotonic_ns() < until:
        data, _ = rci.rci_receive()
        if data:
            note(time.monotonic_ns() - int.from_bytes(data, "little"))


def look(_td: rci.TaskDescriptor) -> None:
    """Look at the word."""
    words, until = seen(), time.monotonic_ns() + LOOK_NS
    before = int(words[WORD])
    while (now := time.monotonic_ns()) < until:
        if (posted := int(words[WORD])) != before:
            note(now - posted)
            before = posted


def note(late_ns: int) -> None:
    """Keep a duration, ns, as long as there is room."""
    words = seen()
    if FIRST + int(words[DONE]) < words.size:
        words[FIRST + int(words[DONE])] = late_ns
        words[DONE] += 1


def latencies(what: str, runs: int) -> NDArray[np.float64]:
    """So many durations, us, of "messages" or "memory" from one processor to another."""
    say, listen = (tell, hear) if what == "messages" else (post, look)
    rci.rci_clock(RATE_HZ)
    tds = [rci.rci_create("say", "aux"), rci.rci_create("look", "aux1")]
    words = rci.rci_shared_memory("seen", 8 * (FIRST + runs)).view(np.int64)
    for td, function in zip(tds, (say, listen), strict=True):
        rci.rci_control(td, function)
    rci.rci_onclock(tds[0], PERIOD, 2)
    rci.rci_onclock(tds[1], PERIOD)
    try:
        rci.rci_start(sum(td.bit for td in tds))
        rci.rci_wait(lambda: words[DONE] >= runs)
    finally:
        rci.rci_close()
    return words[FIRST:].astype(np.float64) / 1e3
