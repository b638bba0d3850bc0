"""Binary semaphores (Corke & Kirkham, section 2.7)."""

from __future__ import annotations

import threading
from typing import Final

from qrobot.arcl.events import CallbackAnswer
from qrobot.arcl.opened import open_robots
from qrobot.arcl.vectors import require_name
from qrobot.errors import MotionError
from qrobot.rci.listening import is_listening

_LOOK_S: Final = 0.5


class Semaphore:
    """A semaphore: set or clear. A function that is called at each sample may use all of it but `pend`.

    Args:
        name: for people.
        value: set at first.
    """

    def __init__(self, name: str = "semaphore", value: bool = True) -> None:
        self.name = name
        self._set = value
        self._changed = threading.Condition()

    @property
    def value(self) -> bool:
        """True when it is set."""
        return self._set

    def take(self) -> bool:
        """Clear it if it is set; false when it was not."""
        with self._changed:
            was, self._set = self._set, False
            return was

    def give(self) -> None:
        """Set it."""
        with self._changed:
            self._set = True
            self._changed.notify()

    def pend(self) -> None:
        """Wait until it is set, and clear it.

        Raises MotionError: no motion is left that could set it; in a program in C, no robot is open that could.
        """
        if self.take():
            return
        robots = open_robots()
        if robots:
            robots[0].wait(self.take)
            return
        if is_listening():  # of a program in C: its threads ask in turns, and this one would keep all others waiting
            raise MotionError(f"sem_pend: no robot is open, so nothing is left that could set {self.name}")
        with self._changed:
            while not self._changed.wait_for(lambda: self._set, _LOOK_S):
                pass
            self._set = False


def new_sem(name: str = "semaphore", value: bool = True) -> Semaphore:
    """A semaphore, set at first unless `value` is false. Raises MotionError: that is no name."""
    require_name("new_sem", name)
    return Semaphore(name, value)


def sem_take(semaphore: Semaphore) -> CallbackAnswer:
    """OK, and it is cleared, if it was set; else ERROR. Never waits."""
    return CallbackAnswer.OK if _semaphore("sem_take", semaphore).take() else CallbackAnswer.ERROR


def sem_give(semaphore: Semaphore) -> CallbackAnswer:
    """Set it."""
    _semaphore("sem_give", semaphore).give()
    return CallbackAnswer.OK


def sem_clear(semaphore: Semaphore) -> CallbackAnswer:
    """Clear it."""
    _semaphore("sem_clear", semaphore).take()
    return CallbackAnswer.OK


def sem_pend(semaphore: Semaphore) -> CallbackAnswer:
    """Wait until it is set, and clear it."""
    _semaphore("sem_pend", semaphore).pend()
    return CallbackAnswer.OK


def _semaphore(call: str, given: object) -> Semaphore:
    if not isinstance(given, Semaphore):
        raise MotionError(f"{call}: a semaphore is needed, from new_sem, not {given!r}")
    return given
