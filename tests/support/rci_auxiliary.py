"""Control functions for processors of their own, which find them here by name; run as a program, one that waits."""

from __future__ import annotations

import os
import time

import numpy as np

from qrobot import rci
from qrobot.rci import TaskDescriptor

TABLE = np.arange(4.0)
START: list[float] = []


def count(td: TaskDescriptor) -> None:
    """Add one to the task's own word of the region "counts"."""
    rci.rci_get_memory("counts").view(np.int64)[td.bit.bit_length()] += 1


def startup(_: TaskDescriptor) -> None:
    """Tell the process."""
    rci.rci_get_memory("counts").view(np.int64)[0] = os.getpid()


def tell_schedule(_: TaskDescriptor) -> None:
    """Tell policy, priority and processors of the thread in which tasks run, in words 1 to 3; word 0 comes last."""
    words = rci.rci_get_memory("counts").view(np.int64)
    words[1] = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
    words[2] = os.sched_getparam(0).sched_priority
    words[3] = sum(1 << cpu for cpu in os.sched_getaffinity(0))
    words[0] = 1


def answer(_: TaskDescriptor) -> None:
    """Send each message back in capitals with the tick it is, change shared data, interrupt the program."""
    data, sender = rci.rci_receive()
    if sender is not None:
        TABLE[1] += 1.0
        counted = rci.rci_descriptor("counter").runs > 0
        rci.rci_send(sender.bit, data.upper() + f" {counted} {rci.rci_ticks()}".encode())
        rci.rci_signal()


def fail(_: TaskDescriptor) -> None:
    """Raise an error of this project's."""
    raise rci.rci_descriptor("nobody").error or LookupError


def fail_to_start(_: TaskDescriptor) -> None:
    """Be a start-up function that finds no sensor."""
    raise LookupError("no sensor")


def hang(_: TaskDescriptor) -> None:
    """Be inside a library for longer than any test waits."""
    time.sleep(1e6)


def swing(td: TaskDescriptor) -> None:
    """Turn joint 1 there and back, by a tenth of a radian."""
    if not START:
        START.extend(td.how.q_setpoint)
    q = START[0] + 0.1 * (1.0 - np.cos(0.05 * td.runs))
    td.chg.go_to((float(q), *START[1:]))


def main() -> None:
    """A program whose task runs elsewhere; tells both processes and waits for its end."""
    td = rci.rci_create("counter", "aux")
    memory = rci.rci_shared_memory("counts", 8 * 32).view(np.int64)
    rci.rci_control(td, count, None, startup)
    rci.rci_onclock(td, 1)
    rci.rci_start(td.bit)
    print(memory[0], flush=True)
    rci.rci_wait(lambda: False)


if __name__ == "__main__":
    main()
