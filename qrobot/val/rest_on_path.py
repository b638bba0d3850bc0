"""Rest of a program's arm on its path, its way back there, and its motions that were interrupted."""

from __future__ import annotations

from contextlib import suppress
from typing import Final

from qrobot.errors import ProgramError
from qrobot.rci.interruption import WholeSamples
from qrobot.val.arm import Destination
from qrobot.val.machine import Machine

STANDSTILL_S: Final = 1.0  # a pause is complete by then
SAMPLES_TO_REST: Final = 5000  # an arm that does not come to rest by then has been lost


class RestOnPath:
    """Brings the arm to rest and back to its path; a Ctrl-C meanwhile never leaves it moving.

    Args:
        machine: whose arm.
        whole: keeps Ctrl-C from what has to stay whole.

    Attributes:
        unfinished: motions that were interrupted, in the order in which they are to be taken up.
        given_up: how often motions were.
    """

    def __init__(self, machine: Machine, whole: WholeSamples) -> None:
        self.unfinished: list[Destination] = []
        self.given_up = 0
        self._machine, self._whole = machine, whole
        self._arm = machine.arm

    def need_path(self) -> None:
        """Raise ProgramError: the arm is off the path of what was begun before."""
        if not self._arm.off_path:
            return
        if stopped := self._arm.kept:
            raise ProgramError(f"{stopped}; PROCEED leads the arm back, QUIT gives its path up")
        raise ProgramError("the arm goes back to its path; PROCEED waits until it is there")

    def go_back(self) -> None:
        """Lead an arm back that is off its path, until it is there or `kept` again; Ctrl-C pauses it on its way."""
        arm = self._arm
        if not arm.off_path:
            return
        with self._whole.waiting():
            arm.resume()
            try:
                while arm.off_path and not arm.kept:
                    arm.sample()
            except KeyboardInterrupt:
                self.pause_on_way_back()
                raise
        if arm.kept:
            arm.pause()  # what is typed alone leads it on, for a program may have to go on with it

    def pause_on_way_back(self) -> None:
        """Let the arm stand still on its way, and wait until it does; another Ctrl-C meanwhile changes nothing.

        One that has come to its path just now rests there, with its motions unfinished.
        """
        arm = self._arm
        arm.pause()
        until_s = arm.time_s + STANDSTILL_S
        while arm.off_path and arm.time_s < until_s:
            with suppress(KeyboardInterrupt):
                arm.sample()
        if not arm.off_path:
            self.halt()
            arm.resume()

    def take_up(self) -> None:
        """Queue the motions that were interrupted. Raises MotionError: one cannot be; it and those behind it stay."""
        while self.unfinished:
            self._machine.go_again(self.unfinished[0])
            del self.unfinished[0]

    def halt(self) -> None:
        """Come to rest on the path, with the motions that were not done unfinished."""
        with self._whole.one():
            self.come_to_rest()
            self.unfinished = self._arm.unfinished() + self.unfinished

    def come_to_rest(self) -> None:
        """Stop the arm on its path and wait until it stands; another Ctrl-C meanwhile changes nothing."""
        while True:
            try:
                self.stop()
                self.settle()
                return
            except KeyboardInterrupt:
                continue

    def settle(self) -> None:
        """Let samples pass until the arm stands."""
        for _ in range(SAMPLES_TO_REST):
            if self._arm.idle or self._arm.kept:
                return
            self._arm.sample()

    def stop(self) -> None:
        """Let the arm come to rest on its path; the next motion begins where it stands."""
        self._arm.stop()
        self._machine.forget_destination()

    def give_up_motions(self) -> None:
        """Let the arm come to rest; its motions count as ended, for PROCEED too, and the hand stays as it is."""
        self.stop()
        self._arm.unfinished()
        self.given_up += 1
