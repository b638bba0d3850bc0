"""Names of processors, and whether a program can have one (section 5.3.1).

host            a thread of the program, with its interpreter and its memory
cpu0, cpu1 ...  a process of its own, kept on that processor of this machine; of one program at a time
aux, aux1 ...   a process of its own, where the system puts it
host:lab2       the host lab2 of the file that QROBOT_HOSTS names, see `hosts`
compiled ...    a thread of the program that never waits for the interpreter, for one task of compiled functions
"""

from __future__ import annotations

import os
import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

from qrobot.errors import ConfigError, LinkBusy
from qrobot.rci.descriptor import HOST
from qrobot.rci.thread_driver import PRIORITY
from qrobot.realtime.setup import set_fifo
from qrobot.realtime.shared_memory import HEADER_WORDS, SharedMemory, segment_path

_LAYOUT = 1
COMPILED: Final = "compiled"


@dataclass(frozen=True)
class ProcessorInfo:
    """One processor for people and programs.

    Attributes:
        name: for `rci_create`.
        description: what it is.
        available: a program can have it now.
        remark: why not; empty otherwise.
    """

    name: str
    description: str
    available: bool = True
    remark: str = ""


def processors() -> list[ProcessorInfo]:
    """Processors of this machine: the host, each of its processors, and one more process that is bound to none.

    Where their threads do not get the real-time scheduler that they ask for, the descriptions say so.
    """
    allowed, but = sorted(os.sched_getaffinity(0)), _scheduler_remark()
    return [
        ProcessorInfo(HOST, f"a thread of the program{but}"),
        *(_cpu_info(cpu, but) for cpu in allowed),
        ProcessorInfo("aux", f"a process of its own, as aux1, aux2 ... too{but}"),
        ProcessorInfo(COMPILED, f"a thread for one task of compiled functions, as compiled1, compiled2 ... too{but}"),
    ]


def _scheduler_remark() -> str:
    """Remark about a scheduler that is refused, else empty. A thread asks for it, so that the caller stays as it is."""
    with ThreadPoolExecutor(1) as pool:
        step = pool.submit(set_fifo, PRIORITY).result()
    return "" if step.ok else f" ({step.detail})"


def _cpu_info(cpu: int, but: str) -> ProcessorInfo:
    name, what = f"cpu{cpu}", f"a process of its own on processor {cpu}{but}"
    try:
        claim_processor(name).close(unlink=True)
    except LinkBusy as error:
        return ProcessorInfo(name, what, False, str(error))
    return ProcessorInfo(name, what)


def check_processor_name(name: str) -> None:
    """Raise ConfigError for a name that is none of a processor, on this machine or any other."""
    if not re.fullmatch(rf"{HOST}|aux\d*|cpu\d+|{COMPILED}\d*", name) and not is_remote(name):
        cpu_of(name)


def is_remote(name: str) -> bool:
    """A processor of that name is on another host."""
    return name.startswith(f"{HOST}:")


def host_name_of(name: str) -> str:
    """The host of a processor on another one."""
    return name.removeprefix(f"{HOST}:")


def is_compiled(name: str) -> bool:
    """A processor of that name runs compiled functions."""
    return re.fullmatch(rf"{COMPILED}\d*", name) is not None


def cpu_of(name: str) -> int | None:
    """The processor of this machine that a name binds to, None for one that binds to none.

    Raises:
        ConfigError: there is no such processor here.
    """
    if re.fullmatch(r"aux\d*", name):
        return None
    found = re.fullmatch(r"cpu(\d{1,4})", name)
    allowed = sorted(os.sched_getaffinity(0))
    if found is None or int(found[1]) not in allowed:
        raise ConfigError(f"no processor {name!r}; {_known(allowed)}")
    return int(found[1])


def _known(allowed: list[int]) -> str:
    cpus = ", ".join(f"cpu{cpu}" for cpu in allowed)
    return f"there are {HOST}, {cpus}, and aux and {COMPILED}, with numbers or without; {HOST}:NAME is another host"


def claim_processor(name: str) -> SharedMemory:
    """Have a processor of this machine as long as the segment is open. Raises LinkBusy when another program has it."""
    try:
        return SharedMemory.create(f"rci-{name}", _LAYOUT, HEADER_WORDS)
    except LinkBusy:
        raise LinkBusy(f"processor {name} belongs to another program ({segment_path(f'rci-{name}')})") from None
