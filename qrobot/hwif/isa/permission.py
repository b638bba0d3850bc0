"""May this thread use the ports of a card? The kernel grants them to threads one by one, and to those they start.

`ioperm(2)` grants single ports below 0x400, `iopl(2)` all of them; both want CAP_SYS_RAWIO, a kernel built with
CONFIG_X86_IOPL_IOPERM, and no kernel lockdown.
"""

from __future__ import annotations

import ctypes
import errno
import os
from typing import Final

from qrobot.errors import ConfigError
from qrobot.hwif.isa.instructions import HAS_PORTS
from qrobot.hwif.registers import WINDOW_BYTES
from qrobot.realtime.setup import SetupStep

LAST_SINGLE_PORT: Final = 0x3FF
_ALL_PORTS: Final = 3
_REMEDIES: Final = {
    errno.EPERM: "run as root or with CAP_SYS_RAWIO; with Secure Boot the kernel may be locked down (lockdown(7))",
    errno.ENOSYS: "this kernel has no port access: it needs CONFIG_X86_IOPL_IOPERM=y",
}


def allow_ports(base: int) -> SetupStep:
    """Ask for the window at `base`, for the calling thread and those it starts from now on."""
    name = f"ports {base:#x}-{base + WINDOW_BYTES - 1:#x}"
    if not HAS_PORTS:
        return SetupStep(name, False, "no port access", "the ISA card needs an x86-64 processor and compiled code")
    try:
        libc = ctypes.CDLL(None, use_errno=True)
        single = base + WINDOW_BYTES - 1 <= LAST_SINGLE_PORT
        refused = libc.ioperm(base, WINDOW_BYTES, 1) if single else libc.iopl(_ALL_PORTS)
    except AttributeError:
        return SetupStep(name, False, "this C library grants no ports", "use Linux with glibc or musl")
    if not refused:
        return SetupStep(name, True, "granted")
    number = ctypes.get_errno()
    return SetupStep(name, False, f"refused: {os.strerror(number)}", _REMEDIES.get(number, "see ioperm(2)"))


def require_ports(base: int) -> SetupStep:
    """The same. Raises ConfigError when they are refused; touching them would kill the process."""
    step = allow_ports(base)
    if not step.ok:
        raise ConfigError(f"{step.name}: {step.detail}; {step.remedy}")
    return step
