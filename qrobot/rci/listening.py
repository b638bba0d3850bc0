"""The end of a program in C, for which its engine listens while it waits for arms: those are to stop then at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Final

from qrobot.errors import QRobotError
from qrobot.rci.bad_end import stop_all

Predicate = Callable[[], bool]


class _Ear:
    """Looks whether the program has ended.

    Args:
        listen: raises QRobotError when it has.
    """

    def __init__(self, listen: Callable[[], object]) -> None:
        self.listen = listen
        self._stopped = False

    def stop_others(self) -> None:
        """Let all arms begin to come to rest, once, at the end of the program."""
        if self._stopped:
            return
        try:
            self.listen()
        except QRobotError:
            self._stopped = True
            with suppress(QRobotError):  # of a function of the program, which does not come back
                stop_all()


class GivesWay(Exception):  # noqa: N818 (no error: the wait is to be begun again)
    """A wait has ended before its time, because another thread of the program wants to ask something."""


_ears: Final[list[_Ear]] = []
_others: Final[list[Predicate]] = []


@contextmanager
def listening(listen: Callable[[], object]) -> Iterator[None]:
    """Have waits for arms listen in this block: `listen` raises QRobotError when the program has ended."""
    _ears.append(_Ear(listen))
    try:
        yield
    finally:
        _ears.pop()


@contextmanager
def giving_way(others_wait: Predicate) -> Iterator[None]:
    """Have a wait for an arm in this block raise `GivesWay` when others wait, once a sample has passed."""
    _others.append(others_wait)
    try:
        yield
    finally:
        _others.remove(others_wait)


def is_listening() -> bool:
    """True within a block of `listening`: predicates of waits belong to the thread of the program then."""
    return bool(_ears)


def listen_once() -> None:
    """Raise QRobotError when the program has ended; does nothing outside of `listening`."""
    for ear in _ears:
        ear.listen()


def heard(predicate: Predicate) -> Predicate:
    """The same predicate of a wait, which raises QRobotError when the program has ended, and may raise `GivesWay`."""

    looked = False

    def listened() -> bool:
        nonlocal looked
        listen_once()
        if predicate():
            return True
        if looked and any(others_wait() for others_wait in _others):
            raise GivesWay
        looked = True  # the first look is before any sample: two waits would give way to each other for ever
        return False

    return listened if _ears else predicate


def heard_on_leaving(predicate: Predicate) -> Predicate:
    """The same predicate of a wait while an arm is let go of: at the end of the program all stop, and it goes on."""

    def listened() -> bool:
        for ear in _ears:
            ear.stop_others()
        return predicate()

    return listened if _ears else predicate
