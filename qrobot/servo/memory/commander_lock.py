"""Lock of an arm's commander: one holder on this machine, whichever way they come.

The bridge holds it for its commander, the control interface for whoever gives it a command that moves or changes
something. It is a small piece of shared memory with a lock that the kernel drops however its holder dies, so nobody
ever has to break it. Looking needs no authority, and neither does stopping: whoever sees an arm go wrong may stop it.
"""

from __future__ import annotations

import contextlib
from typing import Final

import numpy as np

from qrobot.errors import LinkBusy, LinkError
from qrobot.printable import printable
from qrobot.realtime.shared_memory import HEADER_WORDS, SharedMemory, segment_path

LAYOUT: Final = 1
LABEL_BYTES: Final = 128
_N_WORDS: Final = HEADER_WORDS + LABEL_BYTES // 8


class Authority:
    """The right to command one arm, to be taken and given back."""

    def __init__(self, arm: str) -> None:
        self.arm = arm
        self._segment: SharedMemory | None = None

    @property
    def held(self) -> bool:
        """We hold it."""
        return self._segment is not None

    def take(self, label: str) -> None:
        """Hold it, under a name for people. Raises LinkBusy naming the holder when somebody else does."""
        if self._segment is None:
            if holder := self.maybe_holder():
                raise LinkBusy(f"{self.arm} is commanded by {holder}")
            try:  # without waiting: who takes it may be the thread that reads stops
                self._segment = SharedMemory.create(self._name, LAYOUT, _N_WORDS, tries=1)
            except LinkBusy:
                raise LinkBusy(f"{self.arm} is commanded by {self.maybe_holder() or 'somebody'}") from None
        text = label.encode()[:LABEL_BYTES]
        self._segment.words[HEADER_WORDS:] = np.frombuffer(text.ljust(LABEL_BYTES, b"\0"), dtype=np.int64)

    def release(self) -> None:
        """Let go; nothing happens when we do not hold it."""
        if self._segment is not None:
            self._segment.close(unlink=True)
            self._segment = None

    def clear(self) -> None:
        """Remove what a holder that was killed has left behind; a living one is not disturbed."""
        if segment_path(self._name).exists() and not self.held:
            with contextlib.suppress(LinkBusy):
                SharedMemory.create(self._name, LAYOUT, _N_WORDS).close(unlink=True)

    def maybe_holder(self) -> str | None:
        """The holder, in words for people, with the process that is it; None when there is none."""
        try:
            segment = self._segment or SharedMemory.attach(self._name, LAYOUT)
        except LinkError:
            return None
        try:
            if not segment.owner_alive:
                return None
            label = printable(segment.words[HEADER_WORDS:].tobytes().rstrip(b"\0").decode(errors="replace"))
            return f"{label} (process {int(segment.header.owner_pid)})"
        finally:
            if segment is not self._segment:
                segment.close()

    @property
    def holder_was_killed(self) -> bool:
        """True when whoever held it last has died without giving it back, and nobody has taken it since."""
        if self.held:
            return False
        try:
            segment = SharedMemory.attach(self._name, LAYOUT)
        except LinkError:
            return False
        try:
            return not segment.owner_alive and segment.is_current  # one that is given back meanwhile is gone
        finally:
            segment.close()

    @property
    def _name(self) -> str:
        return f"{self.arm}-commander"
