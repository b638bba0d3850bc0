"""A way to the robot that hands everything on to another one, for those who change or hear some of it."""

from __future__ import annotations

from qrobot.rci.client import Beside, ServoLoss
from qrobot.rci.link import Link
from qrobot.wire import Command, State, Welcome


class ForwardingLink:
    """A `Link` that is another one in all that its subclass leaves alone."""

    def __init__(self, link: Link) -> None:
        self.virtual_time = link.virtual_time
        self._link = link

    def open(self) -> Welcome:
        """See `Link.open`."""
        return self._link.open()

    def exchange(self, command: Command | None) -> State:
        """See `Link.exchange`."""
        return self._link.exchange(command)

    def tell(self, packet: Beside) -> None:
        """See `Link.tell`."""
        self._link.tell(packet)

    def refusal(self, kind: type[Beside]) -> str:
        """See `Link.refusal`."""
        return self._link.refusal(kind)

    def take_servo_loss(self) -> ServoLoss:
        """See `Link.take_servo_loss`."""
        return self._link.take_servo_loss()

    def now_ns(self) -> int:
        """See `Link.now_ns`."""
        return self._link.now_ns()

    def reopen(self, period_us: int) -> Welcome:
        """See `Link.reopen`."""
        return self._link.reopen(period_us)

    def close(self, reason: str = "") -> None:
        """See `Link.close`."""
        self._link.close(reason)
