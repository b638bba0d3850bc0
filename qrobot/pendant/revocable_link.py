"""A way to an arm that is about to be taken, and may be given up again before the arm has power: by a STOP, say."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

from qrobot.errors import MotionError
from qrobot.rci import Link, LinkFactory
from qrobot.rci.forwarding_link import ForwardingLink
from qrobot.wire import Command, Hello, Mode, State, Welcome

WITHOUT_POWER: Final = (Mode.OFF, Mode.POWERING)
GIVEN_UP: Final = "the arm was given up before it had power"


class RevokedError(MotionError):
    """The arm was given up before it had power."""


class RevocableLink(ForwardingLink):
    """A `Link` that asks for no power once the arm is given up.

    `open` raises RevokedError then, and so does `exchange` for an arm that has no power, or has got it in the newest
    sample: a request for it may have crossed the word that gave the arm up, and is taken back.

    Args:
        link: the way to the arm.
        given_up: the arm is not to be taken any more, or let go of.
    """

    def __init__(self, link: Link, given_up: Callable[[], bool]) -> None:
        super().__init__(link)
        self._given_up = given_up
        self._powerless = (False, False)  # in the sample before the newest, and in that

    def open(self) -> Welcome:
        """See `Link.open`."""
        if self._given_up():
            raise RevokedError(GIVEN_UP)
        return super().open()

    def exchange(self, command: Command | None) -> State:
        """See `Link.exchange`."""
        self._insist(command)
        state = super().exchange(command)
        self._powerless = self._powerless[1], state.robot.mode in WITHOUT_POWER
        return state

    def _insist(self, command: Command | None) -> None:
        if any(self._powerless) and self._given_up():
            super().exchange(None if command is None else replace(command, power=False))
            raise RevokedError(GIVEN_UP)


def revocable(factory: LinkFactory, given_up: Callable[[], bool]) -> LinkFactory:
    """The same way to the arm, see `RevocableLink`."""

    def link(hello: Hello) -> RevocableLink:
        return RevocableLink(factory(hello), given_up)

    return link
