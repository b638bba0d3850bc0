"""Requests of the page that need no program: stop, power, faults. Each has a thread of its own and waits for nobody."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Final

from qrobot.errors import QRobotError
from qrobot.servo.operator.client import ServoClient
from qrobot.servo.operator.messages import ServoStatus

MOST_STOPS: Final = 4  # of one arm under way: what has been sent need not be sent again
ANSWER_S: Final = 0.2  # patience with the servo's answer to a stop
REPLY_S: Final = 30.0  # with the others
POWER_OFF: Final = "power off"
GO_ON: Final = "take the arm, or start its program anew, to go on"
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
ANYBODY: Final = (POWER_OFF, "pause")  # what makes an arm go on or go faster is for the page that drives


class ServoRequests:
    """Asks the servo of one arm.

    Args:
        arm: instance name.
        tell: takes a line for people, from another thread.
        connect: opens the control interface, with patience in s.
    """

    def __init__(
        self, arm: str, tell: Callable[[str], None], connect: Callable[[str, float], ServoClient] = ServoClient
    ) -> None:
        self._arm, self._tell, self._connect = arm, tell, connect
        self._stops, self._power_offs = (threading.BoundedSemaphore(MOST_STOPS) for _ in range(2))

    def stop(self, by_bridge: bool) -> None:
        """Stop the arm; returns at once, whatever else is under way. `by_bridge`: the bridge was asked as well."""
        self._halt(lambda servo: servo.stop(), "STOP", GO_ON, by_bridge, self._stops)

    def power_off(self, by_bridge: bool) -> None:
        """Stop the arm and take its power away, as `stop` does."""
        self._halt(lambda servo: servo.power_off(), "Power off", "power on to go on", by_bridge, self._power_offs)

    def _halt(self, act: ServoHalt, name: str, go_on: str, by_bridge: bool, room: threading.BoundedSemaphore) -> None:
        def run() -> None:
            try:
                with self._connect(self._arm, ANSWER_S) as servo:
                    self._tell(f"{name} was pressed: the servo is {act(servo).mode}; {go_on}")
            except QRobotError as error:
                self._tell(_unsure(name, error, by_bridge))
            finally:
                room.release()

        if room.acquire(blocking=False):
            threading.Thread(target=run, name=f"pendant-{name}", daemon=True).start()

    def act(self, name: str) -> None:
        """Begin one of `ACTIONS`. Raises KeyError: there is none of that name."""
        self._begin(ACTIONS[name], name)

    def override(self, factor: float) -> None:
        """Change the speed override; returns at once."""
        self._begin(lambda servo: servo.change_override(factor), "override")

    def _begin(self, act: ServoAct, name: str) -> None:
        def run() -> None:
            try:
                with self._connect(self._arm, REPLY_S) as servo:
                    act(servo)
            except QRobotError as error:
                self._tell(f"{name}: {error}")

        threading.Thread(target=run, name=f"pendant-{name}", daemon=True).start()


def _unsure(name: str, error: QRobotError, by_bridge: bool) -> str:
    """Words for people when the servo itself did not say that the arm stands."""
    if by_bridge:
        return f"{name} was sent by the bridge; watch that the arm stands: the servo did not confirm it ({error})"
    return f"{name} HAS NOT REACHED THE ARM: press the emergency stop ({error}; the bridge is away)"
