"""CAN frames over UDP multicast between the processes of one machine, in the packets of python-can's `udp_multicast`.

Python-can's own interface joins the group wherever the routing table says, which is the laboratory's network unless
somebody has added a route. A frame that moves an arm has no business there: this one joins on the loopback interface,
sends there, and lets no packet make a hop.
"""

from __future__ import annotations

import contextlib
import select
import socket
from typing import Any, Final

import can
from can.interfaces.udp_multicast.utils import is_msgpack_installed, pack_message, unpack_message

from qrobot.config.can import multicast_place
from qrobot.errors import ConfigError

GROUP: Final = "239.74.163.2"  # python-can's default for IPv4
_LOOPBACK: Final = "127.0.0.1"
_MAX_PACKET: Final = 4096


class LocalMulticast(can.BusABC):
    """A CAN bus whose nodes are processes of this machine.

    Args:
        channel: multicast group, IPv4; may end in `/PORT`: each pair is a bus of its own.

    Raises:
        ConfigError: not a multicast group of IPv4.
        OSError: the socket cannot be had.
    """

    def __init__(self, channel: str = GROUP) -> None:
        is_msgpack_installed()
        group, port = multicast_place(channel)
        self._to = (_checked_group(group), int(port))
        self._socket = _join(*self._to)
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
        """The next frame, unfiltered; what is no frame is passed over."""
        if not select.select([self._socket], [], [], timeout)[0]:
            return None, False
        with contextlib.suppress(Exception):  # msgpack and python-can raise whatever they like on garbage
            return unpack_message(self._socket.recv(_MAX_PACKET), check=True), False
        return None, False

    def fileno(self) -> int:
        """File descriptor of the socket."""
        return self._socket.fileno()

    def shutdown(self) -> None:
        """Leave the group."""
        super().shutdown()
        self._socket.close()


def _checked_group(group: str) -> str:
    with contextlib.suppress(OSError):
        if 224 <= socket.inet_aton(group)[0] < 240:
            return group
    raise ConfigError(f"{group!r} is no multicast group: take one of 224.0.0.0 to 239.255.255.255, such as {GROUP}")


def _join(group: str, port: int) -> socket.socket:
    opened: Any = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    loopback = socket.inet_aton(_LOOPBACK)
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, loopback)
    opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
    opened.bind((group, port))
    opened.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(group) + loopback)
    return opened  # type: ignore[no-any-return]
