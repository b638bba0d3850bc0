"""The transport over CAN in a deployment file."""

from __future__ import annotations

from typing import Final

from pydantic import Field

from qrobot.config.document import Table
from qrobot.config.values import ExchangePeriod

MULTICAST: Final = "udp_multicast"
MULTICAST_PORT: Final = 43113  # of python-can, where a channel names none


class CanTransport(Table):
    """Address of the board's CANopen node, and the period at which the image is exchanged with it.

    `interface` and `channel` are names of python-can: `socketcan` and `can0`, or `udp_multicast` and a group such as
    `239.74.163.2`, which QRobot keeps on this machine. An exchange of a servo that moves is about ten frames: 1.2 ms at
    1 Mbit/s. One that has no answer after `timeout_ms` has failed. No two arms can be on one bus, for a SYNC reaches
    every node of it.
    """

    interface: str = "socketcan"
    channel: str = "can0"
    bitrate: int = Field(default=1_000_000, ge=10_000, le=1_000_000)
    node_id: int = Field(default=1, ge=1, le=95)
    period_ms: ExchangePeriod = 2.0
    timeout_ms: float = Field(default=50.0, gt=0, le=1000, allow_inf_nan=False)

    @property
    def places(self) -> frozenset[str]:
        """The bus of the board's node."""
        return frozenset([can_bus_words(self.interface, self.channel)])


def multicast_place(channel: str) -> tuple[str, str]:
    """Group and port that a channel of `udp_multicast` names."""
    group, _, port = channel.partition("/")
    return group, port or str(MULTICAST_PORT)


def can_bus_words(interface: str, channel: str) -> str:
    """Words for a bus, which one arm alone can have: what it sends as SYNC makes all nodes act, and feeds watchdogs."""
    if interface == MULTICAST:
        channel = "/".join(multicast_place(channel))
    return f"CAN bus {channel} ({interface}), where a SYNC reaches every node"
