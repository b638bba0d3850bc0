"""A network of this process's own, with nothing but a loopback interface, which plays a cable between hosts.

The interface is given addresses of a private network, so that whoever comes from one of them is no client of the
loopback addresses. Nothing of it can be reached from outside, and the machine's own interfaces are not touched.
"""

from __future__ import annotations

import ctypes
import fcntl
import os
import socket
import struct
from pathlib import Path
from typing import Final

INTERFACE: Final = "lo"
HERE, THERE, STRANGER = "10.77.0.1", "10.77.0.2", "10.77.0.3"
_CLONE_NEWUSER, _CLONE_NEWNET = 0x1000_0000, 0x4000_0000
_SIOCSIFADDR, _SIOCSIFFLAGS = 0x8916, 0x8914  # netdevice(7)
_UP: Final = 1


def leave_the_network() -> None:
    """Give this process, which must have one thread, a network of its own. Raises OSError where that is forbidden."""
    user, group = os.geteuid(), os.getegid()
    kinds = _CLONE_NEWNET if user == 0 else _CLONE_NEWNET | _CLONE_NEWUSER
    if ctypes.CDLL(None, use_errno=True).unshare(kinds) != 0:
        raise OSError(ctypes.get_errno(), "no network of one's own")
    if user != 0:
        Path("/proc/self/setgroups").write_text("deny")
        Path("/proc/self/uid_map").write_text(f"{user} {user} 1")
        Path("/proc/self/gid_map").write_text(f"{group} {group} 1")


def plug(connected: bool) -> None:
    """Plug the cable in, with the addresses of its network, or pull it out."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        name = INTERFACE.encode()
        fcntl.ioctl(control, _SIOCSIFFLAGS, struct.pack("16sH14x", name, _UP if connected else 0))
        if connected:  # the whole network 10/8: each address of it is one of this machine
            address = struct.pack("16sHH4s8x", f"{INTERFACE}:1".encode(), socket.AF_INET, 0, socket.inet_aton(HERE))
            fcntl.ioctl(control, _SIOCSIFADDR, address)
