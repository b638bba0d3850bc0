"""One writer, many readers, no lock: a block of words that is read whole or not at all.

The sequence word is odd while the writer is inside. A reader copies the block and accepts it when the sequence was even
and unchanged. Both sides never wait for each other: a reader that loses `MAX_TRIES` races in a row reports failure.
"""

from __future__ import annotations

from typing import Any

from qrobot.realtime.atomics import acquire_fence, load_acquire, release_fence, store_release
from qrobot.realtime.jit import lean_kernel

MAX_TRIES = 64


@lean_kernel
def seqlock_write(words: Any, seq: int, start: int, source: Any, n: int) -> None:
    """Publish `source[:n]` at `words[start:start+n]`; `words[seq]` is the sequence. Arrays are int64[::1]."""
    before = words[seq]
    store_release(words, seq, before + 1 if before % 2 == 0 else before)
    release_fence()  # whoever sees a word of the new block sees the odd sequence
    for i in range(n):
        words[start + i] = source[i]
    store_release(words, seq, before + 2 if before % 2 == 0 else before + 1)


@lean_kernel
def seqlock_read(words: Any, seq: int, start: int, out: Any, n: int) -> bool:
    """Copy the block into `out[:n]`; False when every try met a writer (or one that died inside)."""
    for _ in range(MAX_TRIES):
        before = load_acquire(words, seq)
        if before % 2 == 0:
            for i in range(n):
                out[i] = words[start + i]
            acquire_fence()  # whoever saw a word of a newer block sees its sequence
            if load_acquire(words, seq) == before:
                return True
    return False
