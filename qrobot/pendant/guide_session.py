"""An arm that is led by hand at the pendant, while a button of a page is held; what it did is recorded."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from qrobot.errors import ServoFault
from qrobot.pendant.held_press import HeldPress, Press
from qrobot.pendant.jog_session import SILENT
from qrobot.pendant.revocable_link import RevokedError, revocable
from qrobot.rccl.guiding import GuidedArm
from qrobot.rccl.setpoints import Setpoints
from qrobot.rci import LinkFactory

NOT_LED: Final = "the arm is taken to be led by hand: let go of it, and take it to jog"


class GuideSession:
    """One command of one arm, to `leave` or to what ends it; the counterpart of `JogSession`.

    Args:
        robot: name or file of the robot.
        link: way to its bridge.
        ready: called when the arm can be led, and after each press.
        tell: takes a line for people.
        clock: seconds; that of the presses.

    Attributes:
        press: what is held in the page that drives; for other threads.
        recordings: of each press, oldest first.
    """

    def __init__(
        self,
        robot: str,
        link: LinkFactory,
        ready: Callable[[], None],
        tell: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.press = HeldPress()
        self.recordings: list[Setpoints] = []
        self._robot, self._link = robot, revocable(link, lambda: self._leaving)
        self._ready, self._tell, self._clock = ready, tell, clock
        self._leaving = False

    def leave(self) -> None:
        """Let go of what is held, bring the arm to rest and end; an arm without power gets none. Returns at once."""
        self.press.end()
        self._leaving = True

    def hand(self, opened: bool) -> None:
        """Leave the hand as it is: an arm that is led has it in somebody's way."""
        self._tell(f"the hand is not {'opened' if opened else 'closed'}: {NOT_LED}")

    def load(self, mass: float, _centre_mm: list[float]) -> None:
        """Leave the load as it is: an arm that is led would sink or rise in somebody's hand."""
        self._tell(f"not {mass:g} kg: let go of the arm before its load is changed")

    def run(self) -> None:
        """Take the arm and serve; raises what ends it before its time, see `GuidedArm`."""
        with suppress(RevokedError), GuidedArm(self._link, self._robot) as arm:
            self.recordings = arm.recordings
            self.press.end()  # what was held before the arm could be led
            self._ready()
            known = 0
            while not self._leaving:
                self._step(arm)
                if len(arm.recordings) > known:
                    known = len(arm.recordings)
                    self._ready()

    def _step(self, arm: GuidedArm) -> None:
        press = self.press.held(self._clock())
        if silence_s := self.press.take_silence():
            self._tell(SILENT.format(silence_s))
        if press is not None and press.target != "guide":
            self._refuse(press)
            press = None
        try:
            arm.step(press is not None)
        except ServoFault as error:  # it holds the arm; the button has to be pressed anew
            self.press.end()
            self._tell(f"the arm is no longer led: {error}")

    def _refuse(self, press: Press) -> None:
        self.press.end_of(press)
        self._tell(f"not done: {NOT_LED}")
