"""Settings of an arm's servo that a program tells beside its setpoints: payload, collisions, analogue outputs."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Final

from qrobot.errors import MotionError
from qrobot.rci.link import Link
from qrobot.wire import AnalogOutputs, Collision, Payload, RobotState

HEARD: Final = 3  # [A] samples in which an answer of the bridge comes


class ArmSettings:
    """Tells them, and waits until the servo has heard.

    Args:
        name: of the arm, for people.
        link: gives the link in use.
        lock: held while what a sample touches is touched; raises what ended control of the arm.
        wait: returns when its predicate, called at every sample, is true; raises what ended control of the arm.
        samples: gives how many there have been.
        how: gives the robot as it was heard last, None before.
    """

    def __init__(
        self,
        name: str,
        link: Callable[[], Link],
        lock: Callable[[], AbstractContextManager[object]],
        wait: Callable[[Callable[[], bool]], object],
        samples: Callable[[], int],
        how: Callable[[], RobotState | None],
    ) -> None:
        self._name, self._link = name, link
        self._lock, self._wait, self._samples, self._how = lock, wait, samples, how
        self._collision: Collision | None = None

    def tell(self, packet: Payload | Collision | AnalogOutputs) -> None:
        """Have the servo take a setting, and wait until it does: a payload is carried in half a second.

        Raises:
            MotionError: it is refused; nothing has changed then.
        """
        with self._lock():
            self._link().tell(packet)
            heard = self._samples() + HEARD
        self._wait(lambda: bool(self._link().refusal) or self._in_force(packet, heard))
        if refusal := self._link().refusal:
            cannot = " cannot carry that" if isinstance(packet, Payload) else ""
            raise MotionError(f"{self._name}{cannot}: {refusal}")
        if isinstance(packet, Collision):
            self._collision = packet

    def tell_again(self) -> None:
        """Tell a bridge that was greeted anew what it has forgotten: how collisions are told."""
        if self._collision is not None:
            self._link().tell(self._collision)

    def _in_force(self, packet: Payload | Collision | AnalogOutputs, heard: int) -> bool:
        if isinstance(packet, Payload):
            return (how := self._how()) is not None and how.payload_mass == packet.mass
        return self._samples() >= heard
