"""CAN frames over UDP multicast between the processes of one account, in the packets of python-can's `udp_multicast`.

Python-can's own interface joins the group wherever the routing table says, which is the laboratory's network unless
somebody has added a route. A frame that moves an arm has no business there: this one joins on the loopback interface,
sends there, lets no packet make a hop, and takes none that has come by another interface.

Nor does a frame of another account of this machine move an arm. A datagram says nothing of whose it is, and its sender
may be gone before anybody asks. But its port cannot be forged, and every node sends from the port of the bus: each one
holds that port at all addresses and shares it by SO_REUSEPORT alone, which the kernel allows to sockets of one account
(socket(7)). So what comes from there is of this account, and the rest is passed over.
"""

from __future__ import annotations

import contextlib
import errno
import os
import select
import socket
from collections.abc import Iterable
from typing import Final

import can
from can.interfaces.udp_multicast.utils import is_msgpack_installed, pack_message, unpack_message

from qrobot.config.can import multicast_place
from qrobot.errors import ConfigError, LinkBusy
from qrobot.realtime.loopback import accounts_at_udp_port

GROUP: Final = "239.74.163.2"  # python-can's default for IPv4
_LOOPBACK: Final = "127.0.0.1"
_MAX_PACKET: Final = 4096
_PACKETS_AT_ONCE: Final = 64  # passed over before a look at the time [A]
_IP_MULTICAST_ALL: Final = 49  # linux/in.h


class LocalMulticast(can.BusABC):
    """A CAN bus whose nodes are processes of this account on this machine.

    Args:
        channel: multicast group, IPv4; may end in `/PORT`: each pair is a bus of its own.

    Attributes:
        refused: packets passed over because nobody has sent them from the port of the bus.

    Raises:
        ConfigError: not a multicast group of IPv4.
        LinkBusy: another account has the port.
        OSError: the sockets cannot be had.
    """

    def __init__(self, channel: str = GROUP) -> None:
        is_msgpack_installed()
        group, port = multicast_place(channel)
        self._to = (_checked_group(group), int(port))
        self.refused = 0
        self._held = _hold(self._to[1])
        try:
            self._socket = _join(*self._to)
        except OSError:
            _close(self._held)
            raise
        self.channel_info = f"local multicast {channel}"
        self._can_protocol = can.CanProtocol.CAN_20
        super().__init__(channel)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002 (of BusABC; never blocks)
        """Send a frame to every process of the bus, this one included. Raises can.CanOperationError."""
        try:
            self._socket.sendto(pack_message(msg), self._to)
        except OSError as error:
            raise can.CanOperationError(str(error)) from error

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        """The next frame, unfiltered; what is no frame, or not of this account, is passed over."""
        if not select.select([self._socket], [], [], timeout)[0]:
            return None, False
        for _ in range(_PACKETS_AT_ONCE):
            try:
                packet, (_, port) = self._socket.recvfrom(_MAX_PACKET, socket.MSG_DONTWAIT)
            except OSError:  # no more
                break
            if port != self._to[1]:
                self.refused += 1
                continue
            with contextlib.suppress(Exception):  # msgpack and python-can raise whatever they like on garbage
                return unpack_message(packet, check=True), False
        return None, False

    def fileno(self) -> int:
        """File descriptor of the socket."""
        return self._socket.fileno()

    def shutdown(self) -> None:
        """Leave the group, and let go of the port."""
        super().shutdown()
        self._socket.close()
        _close(self._held)


def _checked_group(group: str) -> str:
    with contextlib.suppress(OSError):
        if 224 <= socket.inet_aton(group)[0] < 240:
            return group
    raise ConfigError(f"{group!r} is no multicast group: take one of 224.0.0.0 to 239.255.255.255, such as {GROUP}")


def _hold(port: int) -> list[socket.socket]:
    """Sockets that nobody reads: while they are open no other account is given the port, at whatever address.

    One of IPv6 is among them, for such sockets can send to IPv4.

    Raises:
        LinkBusy: another account, or a program that does not share it, has the port already.
    """
    held: list[socket.socket] = []
    try:
        for family in _families():
            held.append(_shared_socket(family))
            held[-1].bind(("", port))
        # The kernel looks no further than the first socket of ours that shares the port: see whether there are others.
        if accounts_at_udp_port(port) <= {0, os.geteuid()}:
            return held
    except OSError as error:
        _close(held)
        if error.errno != errno.EADDRINUSE:
            raise
    _close(held)
    raise LinkBusy(
        f"UDP port {port} is in use by another account or by another kind of program, and a CAN bus over multicast "
        "is that of one account: choose another port, as in udp_multicast:239.74.163.2/43114"
    )


def _families() -> tuple[socket.AddressFamily, ...]:
    """IPv4, and IPv6 where the kernel has it."""
    try:
        socket.socket(socket.AF_INET6, socket.SOCK_DGRAM).close()
    except OSError as error:
        if error.errno != errno.EAFNOSUPPORT:
            raise
        return (socket.AF_INET,)
    return socket.AF_INET, socket.AF_INET6


def _join(group: str, port: int) -> socket.socket:
    opened = _shared_socket(socket.AF_INET)
    loopback = socket.inet_aton(_LOOPBACK)
    try:
        opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, loopback)
        opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        opened.bind((group, port))
        opened.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(group) + loopback)
    except OSError:
        opened.close()
        raise
    return opened


def _shared_socket(family: socket.AddressFamily) -> socket.socket:
    """A socket that shares its port with others of this account, and gets nothing of what they have joined."""
    opened = socket.socket(family, socket.SOCK_DGRAM)
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
    if family == socket.AF_INET6:
        opened.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
    else:
        opened.setsockopt(socket.IPPROTO_IP, _IP_MULTICAST_ALL, 0)
    return opened


def _close(sockets: Iterable[socket.socket]) -> None:
    for each in sockets:
        each.close()
