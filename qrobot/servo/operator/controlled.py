"""The servo process, as far as operator requests touch it."""

from __future__ import annotations

from typing import Protocol

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.hwif.board_memory import BoardSegment
from qrobot.servo.laws.law import Law
from qrobot.servo.laws.law_swap import SwapState
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.stop_record import Incident
from qrobot.servo.settings import ServoSettings


class Controlled(Protocol):
    """Parts of a servo process that operator requests touch."""

    arm: str
    robot: Robot
    settings: ServoSettings
    law: Law
    law_name: str
    board: BoardSegment

    @property
    def mailbox(self) -> ServoMailbox:
        """The servo memory, from the commander's side."""

    @property
    def swap(self) -> SwapState:
        """State of the law swap, through which one is asked for."""

    @property
    def volts(self) -> Floats:
        """Volts at the converter's channels. Shape (8,)."""

    @property
    def force_zero(self) -> Floats:
        """Volts of the force sensor without a load, shape (8,); the loop reads what is written here."""

    @property
    def incident(self) -> Incident | None:
        """Reason for which the servo last left a mode, see `servo.memory.stop_record`."""

    @property
    def page_faults(self) -> int:
        """Page faults of the loop's thread since it began."""

    def say(self, message: str) -> None:
        """Tell people."""
