"""Requests of the page that need no program: stop, power, faults. Each has a thread of its own and waits for nobody."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Final

from qrobot.errors import QRobotError
from qrobot.servo.operator.client import ServoClient

MOST_STOPS: Final = 4  # of one arm under way: what has been sent need not be sent again
ServoAct = Callable[[ServoClient], object]
ACTIONS: Final[dict[str, ServoAct]] = {
    "power on": lambda servo: servo.power_on(),
    "power off": lambda servo: servo.power_off(),
    "clear": lambda servo: servo.clear(),
    "calibrate": lambda servo: servo.calibrate(),
    "pause": lambda servo: servo.pause(),
    "resume": lambda servo: servo.resume(),
    "tare": lambda servo: servo.zero_force(),
}
ANYBODY: Final = ("power off", "pause")  # what makes an arm go on or go faster is for the page that drives


class ServoRequests:
    """Asks the servo of one arm.

    Args:
        arm: instance name.
        tell: takes a line for people, from another thread.
        connect: opens the control interface; tests bring their own.
    """

    def __init__(
        self, arm: str, tell: Callable[[str], None], connect: Callable[[str], ServoClient] = ServoClient
    ) -> None:
        self._arm, self._tell, self._connect = arm, tell, connect
        self._stops = threading.BoundedSemaphore(MOST_STOPS)

    def stop(self) -> None:
        """Stop the arm; returns at once, whatever else is under way."""
        if self._stops.acquire(blocking=False):
            self._begin(lambda servo: servo.stop(), "stop", self._stops.release)

    def act(self, name: str) -> None:
        """Begin one of `ACTIONS`. Raises KeyError: there is none of that name."""
        self._begin(ACTIONS[name], name, lambda: None)

    def override(self, factor: float) -> None:
        """Change the speed override; returns at once."""
        self._begin(lambda servo: servo.change_override(factor), "override", lambda: None)

    def _begin(self, act: ServoAct, name: str, done: Callable[[], None]) -> None:
        def run() -> None:
            try:
                with self._connect(self._arm) as servo:
                    act(servo)
            except QRobotError as error:
                self._tell(f"{name}: {error}")
            finally:
                done()

        threading.Thread(target=run, name=f"pendant-{name}", daemon=True).start()
