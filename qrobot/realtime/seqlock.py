"""One writer, many readers, no lock: a block that is read whole or not at all.

A block is a record with the field `sequence`, which is odd while the writer is inside. A reader copies the block and
accepts it when the sequence was even and unchanged. Both sides never wait for each other: a reader that loses
`MAX_TRIES` races in a row reports failure.
"""

from __future__ import annotations

from typing import Any

from qrobot.realtime.atomics import acquire_fence, load_acquire, release_fence, store_release
from qrobot.realtime.jit import lean_kernel

MAX_TRIES = 64


@lean_kernel
def begin_write(block: Any) -> None:
    """Writer: enter; one that died inside has left the sequence odd, and it stays so."""
    before = block.sequence
    store_release(block, "sequence", before + 1 if before % 2 == 0 else before)
    release_fence()  # whoever sees a word of the new block sees the odd sequence


@lean_kernel
def end_write(block: Any) -> None:
    """Writer: leave; what was written inside is the block from now on."""
    store_release(block, "sequence", block.sequence + 1)


@lean_kernel
def seqlock_read(block: Any, content: Any, out: Any) -> bool:
    """Copy `content`, words of the block, into `out`; False when every try met a writer (or one that died inside)."""
    for _ in range(MAX_TRIES):
        before = load_acquire(block, "sequence")
        if before % 2 == 0:
            for i in range(out.size):
                out[i] = content[i]
            acquire_fence()  # whoever saw a word of a newer block sees its sequence
            if load_acquire(block, "sequence") == before:
                return True
    return False
