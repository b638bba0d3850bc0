"""Requests of the page that need no program: stop, power, faults.

Stop and power-off have a thread each and wait for nobody. The others are done in order of their kind (`RequestLane`),
for of two that were made shortly after each other the newer one has to be in force at the end.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from typing import Final

from qrobot.errors import QRobotError
from qrobot.pendant.request_lane import RequestLane
from qrobot.servo.operator.client import ServoClient
from qrobot.servo.operator.messages import ServoStatus

_log: Final = logging.getLogger(__name__)
MOST_STOPS: Final = 4  # of one arm under way: what has been sent need not be sent again
ANSWER_S: Final = 0.2  # patience with the servo's answer to a stop
REPLY_S: Final = 30.0  # with the others
POWER_OFF: Final = "power off"
OVERRIDE: Final = "override"
LOAD, COLLISION = "load", "collision"
GO_ON: Final = "to go on take the arm, start its program anew, or let one that waits go back to its path"
REACTIONS: Final = {
    "stop": "stops the arm and holds it where it got to",
    "comply": "stops the arm, which is soft for two seconds before it is held",
}
ServoAct = Callable[[ServoClient], object]
ServoHalt = Callable[[ServoClient], ServoStatus]
ACTIONS: Final[dict[str, ServoAct]] = {
    "power on": lambda servo: servo.power_on(),
    POWER_OFF: lambda servo: servo.power_off(),
    "clear": lambda servo: servo.clear(),
    "calibrate": lambda servo: servo.calibrate(),
    "pause": lambda servo: servo.pause(),
    "resume": lambda servo: servo.resume(),
    "tare": lambda servo: servo.zero_force(),
}
OPPOSITES: Final = {"pause": "pause and resume", "resume": "pause and resume"}  # of one kind: the newer one counts
ANYBODY: Final = (POWER_OFF, "pause")  # what makes an arm go on or go faster is for the page that drives


class ServoRequests:
    """Asks the servo of one arm.

    Args:
        arm: instance name.
        tell: takes a line for people, from another thread.
        connect: opens the control interface, with patience in s.

    Attributes:
        unsure: why nobody knows whether the arm has stopped, or lost its power; "" when the newest stop or power-off
            that was answered says so.
        unsures: how many stops and power-offs were not certain.
    """

    def __init__(
        self, arm: str, tell: Callable[[str], None], connect: Callable[[str, float], ServoClient] = ServoClient
    ) -> None:
        self._arm, self._tell, self._connect = arm, tell, connect
        self._stops, self._power_offs = (threading.BoundedSemaphore(MOST_STOPS) for _ in range(2))
        kinds = {OPPOSITES.get(name, name) for name in (*ACTIONS, OVERRIDE, LOAD, COLLISION)}
        self._lanes = {kind: RequestLane(kind) for kind in kinds}
        self.unsure, self.unsures = "", 0
        self._lock = threading.Lock()  # of both, and of the numbers of stops and power-offs
        self._asked = self._confirmed = self._doubted = 0

    def stop(self, by_bridge: bool, why: str = "STOP was pressed") -> None:
        """Stop the arm; returns at once, whatever is under way, and requests that wait are forgotten.

        `by_bridge`: the bridge was asked as well. `why`: for people, as told when the servo has answered.
        """
        self._halt(lambda servo: servo.stop(), "STOP", GO_ON, by_bridge, self._stops, why)

    def power_off(self, by_bridge: bool) -> None:
        """Stop the arm and take its power away, as `stop` does."""
        why = "Power off was pressed"
        self._halt(lambda servo: servo.power_off(), "Power off", "power on to go on", by_bridge, self._power_offs, why)

    def _halt(
        self, act: ServoHalt, name: str, go_on: str, by_bridge: bool, room: threading.BoundedSemaphore, why: str
    ) -> None:
        with self._lock:
            self._asked += 1
            number = self._asked

        def run() -> None:
            try:
                with self._connect(self._arm, ANSWER_S) as servo:
                    mode = act(servo).mode
                self._confirm(number, f"{why}: the servo is {mode}; {go_on}")
            except Exception as error:  # one that is none of ours as well: the servo has confirmed nothing
                if not isinstance(error, QRobotError):
                    _log.exception("%s could not be asked of the servo", name)
                self._doubt(number, _unsure(name, error, by_bridge))
            finally:
                room.release()

        for lane in self._lanes.values():
            lane.drop()  # what was asked for before
        if room.acquire(blocking=False):
            try:
                threading.Thread(target=run, name=f"pendant-{name}", daemon=True).start()
            except RuntimeError:  # no more threads: the next one has a place again
                room.release()
                self._doubt(number, f"{why}: no thread is left to ask the servo by itself; press again")

    def _confirm(self, number: int, text: str) -> None:
        """The servo has answered a stop or a power-off: earlier ones no longer matter."""
        with self._lock:
            self._confirmed = max(self._confirmed, number)
            if number >= self._doubted:
                self.unsure = ""
        self._tell(text)

    def _doubt(self, number: int, text: str) -> None:
        """One was not answered, which is told until one that is as new was."""
        with self._lock:
            if number > self._confirmed:
                self._doubted = max(self._doubted, number)
                self.unsure, self.unsures = text, self.unsures + 1
        self._tell(text)

    def act(self, name: str) -> None:
        """Begin one of `ACTIONS`. Raises KeyError: there is none of that name."""
        self._begin(ACTIONS[name], name)

    def override(self, factor: float) -> None:
        """Change the speed override; returns at once. The newest of several is in force at the end."""
        self._begin(lambda servo: servo.change_override(factor), OVERRIDE)

    def load(self, mass: float, centre_m: Sequence[float]) -> None:
        """Let the servo reckon with a load, kg and m; told when it does, or why it does not. Returns at once."""

        def change(servo: ServoClient) -> None:
            self._tell(f"the servo reckons with {servo.change_payload(mass, centre_m).payload_mass:g} kg in the hand")

        self._begin(change, LOAD)

    def collision(self, thresholds: Sequence[float], reaction: str) -> None:
        """Choose when a collision is told, N m (N) of each joint, and what follows; told when it counts."""

        def change(servo: ServoClient) -> None:
            servo.change_collision(thresholds, reaction)
            self._tell(f"after a collision the servo {REACTIONS[reaction]}")

        self._begin(change, COLLISION)

    def _begin(self, act: ServoAct, name: str) -> None:
        def run() -> None:
            try:
                with self._connect(self._arm, REPLY_S) as servo:
                    act(servo)
            except QRobotError as error:
                self._tell(f"{name}: {error}")

        self._lanes[OPPOSITES.get(name, name)].put(run)


def _unsure(name: str, error: Exception, by_bridge: bool) -> str:
    """Words for people when the servo itself did not say that the arm stands."""
    why = str(error) if isinstance(error, QRobotError) else f"{type(error).__name__}: {error}"
    if by_bridge:
        return f"{name} was sent by the bridge; watch that the arm stands: the servo did not confirm it ({why})"
    return f"{name} HAS NOT REACHED THE ARM: press the emergency stop ({why}; the bridge is away)"
