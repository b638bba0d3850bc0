"""The loopback interface: which addresses are of it, and which accounts of this machine are at its ports."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from ipaddress import IPv4Address, IPv6Address, ip_address
from pathlib import Path
from typing import Final

from qrobot.realtime.socket_diag import ESTABLISHED, PeerAddress, is_answered, maybe_socket

TABLES: Final = (Path("/proc/net/tcp"), Path("/proc/net/tcp6"))
UDP_TABLES: Final = (Path("/proc/net/udp"), Path("/proc/net/udp6"))
_LOCAL, _REMOTE, _STATE, _ACCOUNT, _INODE = 1, 2, 3, 7, 9  # columns, proc(5)
_LOOKS: Final = 3  # [A] the kernel's table may leave out a line while others of it go


def is_loopback(host: str) -> bool:
    """True for an address of the loopback interface; anything that is no IP address is not."""
    try:
        return _plain(host).is_loopback
    except ValueError:
        return False


def maybe_peer_account(connection: socket.socket) -> int | None:
    """Account of the process at the other end of a TCP connection; None when none on this machine has it open.

    Their socket is the one whose local address is our remote one, and the other way round. Asking costs the same
    however many connections there are, unless the kernel answers by its tables alone.
    """
    try:
        ours, theirs = connection.getsockname(), connection.getpeername()
    except OSError:
        return None
    return maybe_account_between(theirs[:2], ours[:2])


def maybe_account_between(theirs: tuple[str, int], ours: tuple[str, int]) -> int | None:
    """`maybe_peer_account` of a connection whose two ends, host and port, are known."""
    try:
        wanted = (_plain(theirs[0]), theirs[1]), (_plain(ours[0]), ours[1])
    except ValueError:
        return None
    if is_answered():
        return _answered(*wanted)
    return _found_in_tables(wanted)


def accounts_at_udp_port(port: int) -> set[int]:
    """Accounts that have sockets at a UDP port of this machine, at whatever address."""
    return {int(columns[_ACCOUNT]) for columns in _lines(UDP_TABLES) if _endpoint(columns[_LOCAL])[1] == port}


def _answered(local: PeerAddress, remote: PeerAddress) -> int | None:
    """The kernel's answer about one socket. One that is closed has no inode, and account 0, whoever's it was."""
    try:
        found = maybe_socket(local, remote)
    except OSError:  # short of memory, or of files: nobody is known
        return None
    if found is None or found.state != ESTABLISHED or not found.inode or (found.local, found.remote) != (local, remote):
        return None
    return found.account


def _found_in_tables(wanted: tuple[PeerAddress, PeerAddress]) -> int | None:
    for _ in range(_LOOKS):
        for local, remote, account in _connections():
            if (local, remote) == wanted:
                return account
    return None


def _connections() -> Iterator[tuple[PeerAddress, PeerAddress, int]]:
    for columns in _lines(TABLES):
        if int(columns[_STATE], 16) != ESTABLISHED or columns[_INODE] == "0":  # closed: its account is told as 0
            continue
        yield _endpoint(columns[_LOCAL]), _endpoint(columns[_REMOTE]), int(columns[_ACCOUNT])


def _lines(tables: tuple[Path, ...]) -> Iterator[list[str]]:
    """The columns of each line, the heads left out."""
    for table in tables:
        try:
            lines = table.read_text().splitlines()[1:]
        except OSError:  # no IPv6
            continue
        yield from map(str.split, lines)


def _endpoint(text: str) -> PeerAddress:
    """Address and port as /proc writes them: words of 32 bits in the order of this machine, in hexadecimal."""
    address, port = text.split(":")
    words = (int(address[k : k + 8], 16) for k in range(0, len(address), 8))
    packed = b"".join(struct.pack("=I", word) for word in words)
    return _plain(str(ip_address(packed))), int(port, 16)


def _plain(host: str) -> IPv4Address | IPv6Address:
    """An address; an IPv4 one also when it is written as IPv6. Raises ValueError."""
    address = ip_address(host)
    return getattr(address, "ipv4_mapped", None) or address
