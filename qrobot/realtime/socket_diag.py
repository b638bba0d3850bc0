"""The kernel's answer to who has one TCP socket of this machine open (sock_diag(7), linux/inet_diag.h).

A question names both ends and costs one message each way, whatever else is connected. The tables of /proc are written
out for each reader instead, and anybody makes them longer: a connection that was closed stays there for a minute.
"""

from __future__ import annotations

import errno
import functools
import socket
import struct
from ipaddress import IPv4Address, IPv6Address
from typing import Final, NamedTuple

Address = IPv4Address | IPv6Address
PeerAddress = tuple[Address, int]

# linux/netlink.h, linux/sock_diag.h
NETLINK_SOCK_DIAG: Final = 4
SOCK_DIAG_BY_FAMILY: Final = 20
NLMSG_ERROR: Final = 2
NLM_F_REQUEST: Final = 1
_HEADER: Final = struct.Struct("=IHHII")  # nlmsghdr: length, type, flags, sequence, port
_ERROR: Final = struct.Struct("=i")

# linux/inet_diag.h
_REQUEST: Final = struct.Struct("=BBBxI")  # inet_diag_req_v2: family, protocol, extensions, states
_ENDS: Final = struct.Struct("!HH16s16s")  # inet_diag_sockid: ports and addresses, its own before the other
_NO_COOKIE: Final = 0xFFFFFFFF
_BEHIND_ENDS: Final = struct.Struct("=III")  # interface, cookie
_STATE: Final = struct.Struct("=BB2x")  # inet_diag_msg: family, state
_COUNTS: Final = struct.Struct("=12x12xII")  # interface and cookie, timer and queues, account, inode
_ANY_STATE: Final = 0xFFFFFFFF
ESTABLISHED: Final = 1  # linux/tcp_states.h
LISTEN: Final = 10
_FAMILY: Final = {4: socket.AF_INET, 6: socket.AF_INET6}
_ANSWER_BYTES: Final = 4096  # a message without extensions has less than a hundred


class FoundSocket(NamedTuple):
    """A socket of this machine: its state, its two ends, its account, and its inode, 0 when no process has it."""

    state: int
    local: PeerAddress
    remote: PeerAddress
    account: int
    inode: int


@functools.cache
def is_answered() -> bool:
    """Whether this kernel answers. One that has no such service says what it says of a socket that does not exist."""
    try:
        with socket.create_server(("127.0.0.1", 0)) as there:
            local = IPv4Address("127.0.0.1"), there.getsockname()[1]
            found = maybe_socket(local, (local[0], 0))
    except OSError:
        return False
    return found is not None and found.state == LISTEN


def maybe_socket(local: PeerAddress, remote: PeerAddress) -> FoundSocket | None:
    """The TCP socket with these ends, or the listening one that is there for them; None when there is none.

    An IPv4 address is asked for as such, also where a socket of IPv6 has it. Raises OSError when nothing is answered.
    """
    if local[0].version != remote[0].version:
        return None
    answer = _ask(_question(local, remote))
    _, kind, *_ = _HEADER.unpack_from(answer)
    if kind == SOCK_DIAG_BY_FAMILY:
        return _read(answer)
    code = -_ERROR.unpack_from(answer, _HEADER.size)[0] if kind == NLMSG_ERROR else errno.EPROTO
    if code == errno.ENOENT:
        return None
    raise OSError(code, "the kernel does not tell who has a socket open")


def _question(local: PeerAddress, remote: PeerAddress) -> bytes:
    ends = _ENDS.pack(local[1], remote[1], local[0].packed.ljust(16, b"\0"), remote[0].packed.ljust(16, b"\0"))
    request = _REQUEST.pack(_FAMILY[local[0].version], socket.IPPROTO_TCP, 0, _ANY_STATE)
    body = request + ends + _BEHIND_ENDS.pack(_loopback_index(), _NO_COOKIE, _NO_COOKIE)
    return _HEADER.pack(_HEADER.size + len(body), SOCK_DIAG_BY_FAMILY, NLM_F_REQUEST, 0, 0) + body


def _loopback_index() -> int:
    """The interface asked for: sockets that are tied to it are found besides those that are tied to none."""
    try:
        return socket.if_nametoindex("lo")
    except OSError:
        return 0


def _ask(question: bytes) -> bytes:
    """The kernel has answered when it has taken the question: nobody waits."""
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, NETLINK_SOCK_DIAG) as kernel:
        kernel.sendto(question, (0, 0))
        return kernel.recv(_ANSWER_BYTES, socket.MSG_DONTWAIT)


def _read(answer: bytes) -> FoundSocket:
    at = _HEADER.size
    family, state = _STATE.unpack_from(answer, at)
    ports_and_addresses = _ENDS.unpack_from(answer, at + _STATE.size)
    account, inode = _COUNTS.unpack_from(answer, at + _STATE.size + _ENDS.size)
    local, remote = ((_address(family, ports_and_addresses[end + 2]), ports_and_addresses[end]) for end in (0, 1))
    return FoundSocket(state, local, remote, account, inode)


def _address(family: int, words: bytes) -> Address:
    if family == socket.AF_INET:
        return IPv4Address(words[:4])
    address = IPv6Address(words)
    return address.ipv4_mapped or address
