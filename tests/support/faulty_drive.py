"""A drive of CiA 402 that faults whenever it comes to one of its states."""

from __future__ import annotations

from dataclasses import dataclass

from qrobot.hwif.canbus.ds402 import DriveState
from tests.support.emulated_drives import EmulatedDrive

OVERCURRENT = 0x2310


@dataclass
class FaultyDrive(EmulatedDrive):
    """An `EmulatedDrive` that faults `at` a state, and at once or with the next control word.

    Attributes:
        enabled: times it was let operate.
    """

    at: DriveState = DriveState.ENABLED
    at_once: bool = True
    enabled: int = 0

    def control(self, word: int) -> None:
        """Act on a control word, and fault."""
        before = self.state
        if self._is_there and not self.at_once:
            self.fail(OVERCURRENT)
            return
        super().control(word)
        self.enabled += self.state is DriveState.ENABLED is not before
        if self._is_there and self.at_once:
            self.fail(OVERCURRENT)

    @property
    def _is_there(self) -> bool:
        return self.state is self.at
