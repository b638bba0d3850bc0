"""Waiting for descriptors, to the microsecond, by ppoll(2): of any number, and with those named that are closed."""

from __future__ import annotations

import ctypes
import errno
import select
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from qrobot.units import NS_PER_S

_POLLFD: Final = np.dtype([("fd", np.int32), ("events", np.int16), ("revents", np.int16)])  # <poll.h>
_libc = ctypes.CDLL(None, use_errno=True)


class _Timespec(ctypes.Structure):
    _fields_ = (("tv_sec", ctypes.c_long), ("tv_nsec", ctypes.c_long))


@dataclass(frozen=True)
class Readiness:
    """Descriptors that can be read, end of file and errors included, and those that are closed."""

    readable: set[int]
    closed: set[int]


def await_readable(descriptors: Iterable[int], patience_s: float | None) -> Readiness:
    """Wait until one of the descriptors is readable or found closed, at most so long; None waits for ever.

    A signal ends the wait early. Raises OSError: the system has no memory for so many.
    """
    table = np.array([(fd, select.POLLIN, 0) for fd in descriptors], _POLLFD)
    seconds, rest_ns = divmod(round((patience_s or 0.0) * NS_PER_S), NS_PER_S)
    timeout = None if patience_s is None else ctypes.byref(_Timespec(seconds, rest_ns))
    found = _libc.ppoll(table.ctypes.data_as(ctypes.c_void_p), ctypes.c_ulong(table.size), timeout, None)
    if found < 0 and (number := ctypes.get_errno()) != errno.EINTR:
        raise OSError(number, "ppoll")
    if found <= 0:
        return Readiness(set(), set())
    closed = table["fd"][(table["revents"] & select.POLLNVAL) != 0]
    readable = table["fd"][(table["revents"] & ~select.POLLNVAL) != 0]
    return Readiness(set(readable.tolist()), set(closed.tolist()))


def check_open(descriptor: int) -> None:
    """Raise OSError for a descriptor that is not open, ValueError for a number that is none."""
    if descriptor < 0:
        raise ValueError(f"{descriptor} is no descriptor")
    if await_readable([descriptor], 0.0).closed:
        raise OSError(errno.EBADF, "it is closed")
