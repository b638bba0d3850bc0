"""A link in lock-step: the server runs in this process, and its time passes only while a program waits."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Final, TypeAlias, TypeVar

from qrobot.errors import QRobotError
from qrobot.rci.client import Beside, Client, ServoLoss
from qrobot.rci.link import NEW_PERIOD
from qrobot.wire import Command, Hello, State, Welcome

Transfer: TypeAlias = Callable[[bytes], bytes]
"""Hands bytes (perhaps none) to the server, lets virtual time run until it has something to say, returns that."""

_PATIENCE: Final = 1000  # transfers; the longest sample period is a hundred of the shortest
T = TypeVar("T")


class VirtualLink:
    """A `Link` on virtual time.

    Args:
        hello: how to greet.
        transfer: the way to the server and back, given by whoever put server and program together.
    """

    virtual_time = True

    def __init__(self, hello: Hello, transfer: Transfer) -> None:
        self._hello = hello
        self._client = self._new_client()
        self._transfer = transfer
        self._now_ns = 0

    def open(self) -> Welcome:
        """Greet; see `Link.open`."""
        welcome = self._await(self._client.greet(), self._client.pop_welcome)
        self._now_ns = welcome.t_ns
        return welcome

    def exchange(self, command: Command | None) -> State:
        """Send, and let time run until the next STATE; see `Link.exchange`."""
        state = self._await(self._client.say(command), self._client.pop_state)
        self._now_ns = state.robot.t_ns
        return state

    def tell(self, packet: Beside) -> None:
        """Send a packet with the next `exchange`; see `Link.tell`."""
        self._client.tell(packet)

    def refusal(self, kind: type[Beside]) -> str:
        """See `Link.refusal`."""
        return self._client.refusals.get(kind, "")

    def take_servo_loss(self) -> ServoLoss:
        """See `Link.take_servo_loss`."""
        loss, self._client.servo_loss = self._client.servo_loss, ServoLoss.NONE
        return loss

    def now_ns(self) -> int:
        """Virtual time of the newest packet."""
        return self._now_ns

    def reopen(self, period_us: int) -> Welcome:
        """See `Link.reopen`."""
        self.close(NEW_PERIOD)
        self._hello = replace(self._hello, period_us=period_us)
        self._client = self._new_client()
        return self.open()

    def close(self, reason: str = "") -> None:
        """Say goodbye."""
        if farewell := self._client.farewell(reason):
            with suppress(QRobotError):
                self._transfer(farewell)

    def _new_client(self) -> Client:
        return Client(self._hello, "the bridge in this process")

    def _await(self, data: bytes, pop: Callable[[], T | None]) -> T:
        for _ in range(_PATIENCE):
            if (answer := pop()) is not None:
                return answer
            if heard := self._transfer(data):
                self._client.take(heard)
            data = b""
        raise self._client.silence()
