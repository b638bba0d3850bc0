"""Settings of an arm's servo that a program tells beside its setpoints: payload, collisions, analogue outputs."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Final

from qrobot.errors import MotionError
from qrobot.rci.link import Link
from qrobot.wire import AnalogOutputs, Collision, Payload, RobotState

HEARD: Final = 3  # [A] samples in which an answer of the bridge comes
CARRIED_NS: Final = 500_000_000  # in which a servo goes over to a payload (`servo.stages.payload`)
OWED_NS: Final = 1_000_000_000  # [A] from telling a new servo to carrying: half of it goes over to the payload
ANSWER_NS: Final = 3_000_000_000  # [A] in which a payload that was heard is carried, whatever else the servo does


class ArmSettings:
    """Tells them, and waits until the servo has heard.

    Args:
        name: of the arm, for people.
        link: gives the link in use.
        lock: held while what a sample touches is touched; raises what ended control of the arm.
        wait: returns when its predicate, called at every sample, is true; raises what ended control of the arm.
        samples: gives how many there have been.
        how: gives the robot as it was heard last, None before.

    Attributes:
        accepted: called with how collisions are told, when that was not refused.
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
        self.accepted: Callable[[Collision], object] = lambda _: None
        self._collision: Collision | None = None
        self._load = CarriedLoad()

    def tell(self, packet: Payload | Collision | AnalogOutputs) -> None:
        """Have the servo take a setting, and wait until it does: a payload is carried in half a second.

        Raises:
            MotionError: it is refused; nothing has changed then. Or nobody answers.
        """
        kind = type(packet)
        with self._lock():
            before = self._how()
            self._link().tell(packet)
            heard = self._samples() + HEARD
        self._wait_unless_refused(kind, lambda: self._samples() >= heard)
        if isinstance(packet, Payload) and before is not None and (since := self._how()) is not None:
            self._wait_unless_refused(kind, lambda: self._carries(packet.mass, before, since))
        if refusal := self._link().refusal(kind):
            cannot = " cannot carry that" if isinstance(packet, Payload) else ""
            raise MotionError(f"{self._name}{cannot}: {refusal}")
        if isinstance(packet, Collision):
            self._collision = packet
            self.accepted(packet)
        elif isinstance(packet, Payload):
            self._load.carry(packet)

    def tell_again(self, now: RobotState | None = None, forgotten: bool = True) -> None:
        """Tell a bridge or a servo that has `forgotten` it how collisions are told.

        And the payload, when a servo that shows itself in `now` carries nothing any more; None for the same servo.
        """
        if not forgotten:
            return
        if self._collision is not None:
            self._link().tell(self._collision)
        if now is not None and (load := self._load.lost(self._how(), now)) is not None:
            self._link().tell(load)

    def _wait_unless_refused(self, kind: type[Payload | Collision | AnalogOutputs], done: Callable[[], bool]) -> None:
        self._wait(lambda: bool(self._link().refusal(kind)) or done())

    def _carries(self, mass: float, before: RobotState, since: RobotState) -> bool:
        """Whether the servo goes by a payload, which `before` it was told, and `since` it had heard.

        One of the same mass shows by nothing. Raises MotionError: there is no answer.
        """
        how = self._how() or since
        passed_ns = how.t_ns - since.t_ns
        if how.payload_mass == mass:
            return before.payload_mass != mass or passed_ns >= CARRIED_NS
        if passed_ns > ANSWER_NS:
            raise MotionError(f"{self._name} has not answered: it carries {how.payload_mass:g} kg still")
        return False


class CarriedLoad:
    """A program's payload, which a servo that has started anew has to be told again."""

    def __init__(self) -> None:
        self._load = Payload(0.0)
        self._told_ns = -OWED_NS  # time of the servo that was told again last

    def carry(self, load: Payload) -> None:
        """Take note that the servo carries it from now on."""
        self._load = load

    def lost(self, before: RobotState | None, now: RobotState) -> Payload | None:
        """The load in force `before` servo, or the way to it, was away; None unless a new one carries none `now`.

        It is owed as well to the servo behind one that had no time to carry it. A payload that somebody else has told
        since stays.
        """
        if before is None or now.payload_mass != 0.0 or self._load.mass == 0.0:
            return None
        owed = 0 <= before.t_ns - self._told_ns < OWED_NS
        if before.payload_mass != self._load.mass and not owed:
            return None
        self._told_ns = now.t_ns
        return self._load
