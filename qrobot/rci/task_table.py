"""Table that the tasks of a program share: descriptors, memory, data and messages (section 4.3.5)."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from qrobot.arrays import Words
from qrobot.errors import ConfigError
from qrobot.rci.descriptor import TaskDescriptor
from qrobot.rci.mail_lane import (
    LANE_WORDS,
    LARGEST_MESSAGE,
    NO_MESSAGE,
    has_room,
    oldest_stamp,
    prepare_messages,
    put_message,
    take_message,
    words_of,
)

ALL: Final = (1 << 31) - 1
Bytes = NDArray[np.uint8]


@dataclass(frozen=True)
class SharedArea:
    """A region of shared memory and who may reach it."""

    label: str
    memory: Bytes
    access: int


class TaskTable:
    """Descriptors, memory and messages of one program, as one of its processors sees them.

    Args:
        stamp: numbers that never fall, by which messages are kept in their order.
    """

    def __init__(self, stamp: Callable[[], int]) -> None:
        self._stamp = stamp
        self._by_name: dict[str, TaskDescriptor] = {}
        self._areas: dict[str, SharedArea] = {}
        prepare_messages()

    # ----------------------------------------------------------------------------------------------------- descriptors

    def add(self, td: TaskDescriptor) -> None:
        """Let all know a task."""
        self._by_name[td.name] = td

    def knows(self, name: str) -> bool:
        """True when there is a task of that name."""
        return name in self._by_name

    def find(self, name: str) -> TaskDescriptor:
        """The descriptor of a name. Raises ConfigError: there is no such task."""
        if name not in self._by_name:
            raise ConfigError(f"no task {name!r}; there are {', '.join(self._by_name)}")
        return self._by_name[name]

    def of(self, mask: int, what: str) -> list[TaskDescriptor]:
        """The tasks that a mask names, in the order of their bits; ALL names every one.

        Raises:
            ConfigError: no mask, or it names a task that is not there.
        """
        known = sum(td.bit for td in self._by_name.values())
        if not isinstance(mask, int) or isinstance(mask, bool) or mask < 0 or (mask != ALL and mask & ~known):
            raise ConfigError(f"{what}: {mask!r} is no mask of tasks; all together are {known:#x}")
        return [td for td in self._by_name.values() if td.bit & mask]

    # ---------------------------------------------------------------------------------------------------------- memory

    def share(self, area: SharedArea) -> None:
        """Let the tasks know a region of memory. Raises ConfigError: there is one of that label."""
        if area.label in self._areas:
            raise ConfigError(f"shared memory {area.label!r} is there already")
        self._areas[area.label] = area

    def memory(self, label: str, td: TaskDescriptor) -> Bytes:
        """The region of that label, for a task that may reach it. Raises ConfigError."""
        area = self._areas.get(label)
        if area is None:
            raise ConfigError(f"no shared memory {label!r}; there is {', '.join(self._areas) or 'none'}")
        if not area.access & td.bit:
            raise ConfigError(f"task {td.name} may not reach {label!r}: its bit {td.bit:#x} is not in {area.access:#x}")
        return area.memory

    # -------------------------------------------------------------------------------------------------------- messages

    def send(self, sender: TaskDescriptor, mask: int, data: bytes) -> int:
        """Queue a message for each task of the mask; the bytes queued: 0, for none of them, when one has no room."""
        receivers = [td for td in self.of(mask, "send") if td is not sender]
        if not receivers:
            raise ConfigError(f"send: mask {mask:#x} names no task but {sender.name}, which sends; name another")
        if not 1 <= len(data) <= LARGEST_MESSAGE:
            raise ConfigError(f"send: a message has 1 to {LARGEST_MESSAGE} bytes, not {len(data)}")
        words, lanes = words_of(data), [td.lane_from(sender.bit) for td in receivers]
        if not all(has_room(lane, words) for lane in lanes):
            return 0
        stamp = self._stamp()
        return min(put_message(lane, stamp, len(data), words) for lane in lanes)

    def receive(self, receiver: TaskDescriptor, mask: int) -> tuple[bytes, TaskDescriptor | None]:
        """The oldest message for a task from those of the mask, with its sender; none: no bytes and no sender."""
        senders = [td for td in self.of(mask, "receive") if td is not receiver]
        stamps = {td.bit: oldest_stamp(receiver.lane_from(td.bit)) for td in senders}
        first = min(senders, key=lambda td: stamps[td.bit], default=None)
        if first is None or stamps[first.bit] == NO_MESSAGE:
            return b"", None
        payload: Words = np.empty(LANE_WORDS, np.int64)  # of this call: tasks and program receive at the same time
        n_bytes = take_message(receiver.lane_from(first.bit), payload)
        return payload.tobytes()[:n_bytes], first


@dataclass(frozen=True)
class SharedProgram:
    """A program as its tasks know it, on whichever processor they run."""

    table: TaskTable
    parent: TaskDescriptor
    clock_ticks: Callable[[], int]
    parent_pid: int


def catches(pid: int, number: int) -> bool:
    """True when a process has a handler for a signal, by what the kernel says of it (proc(5), SigCgt)."""
    status = Path(f"/proc/{pid}/status").read_text()
    found = re.search(r"^SigCgt:\s*([0-9a-f]+)", status, re.MULTILINE)
    return found is not None and bool(int(found[1], 16) >> (number - 1) & 1)


def signal_parent(pid: int, number: int) -> None:
    """Send a signal to the planning program. Raises ConfigError when it has no handler, which would end it."""
    if not catches(pid, number):
        raise ConfigError(f"the program has no handler for signal {number}, which would end it: signal.signal() first")
    os.kill(pid, number)
