"""Arm power of separate drives: all are led to SWITCHED ON, operate together from there, and are off when one fails.

A drive in OPERATION ENABLED opens its brake, and its motor has no torque until the others are there too. Therefore none
is let operate before all can, and power has to be asked for anew where

* a drive faults again after its fault was reset: that is done once for each time that power is asked for;
* a drive does not follow when all are let operate, or not for `OPERATE_PATIENCE_MS` while another one already does;
* a drive leaves OPERATION ENABLED by itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import ceil
from typing import Final

from qrobot.hwif.canbus.ds402 import ENABLE_OPERATION, FAULT_RESET, SWITCH_ON, DriveState, towards_operation
from qrobot.hwif.canbus.setpoints import DriveFeedback
from qrobot.report import Report

OPERATE_PATIENCE_MS: Final = 100.0  # [A] drives of one kind open their brakes within some tens of ms of one another
TELL_AFTER_MS: Final = 1000.0  # [A] sooner than the servo gives up; mains contactors and capacitors take less
_UP: Final = (DriveState.SWITCHED_ON, DriveState.ENABLED)
_FAULTY: Final = (DriveState.FAULT, DriveState.FAULT_REACTION)


class DrivesPower:
    """State of the power of an arm's drives, from one exchange to the next.

    Args:
        drives: by node, as they are heard.
        period_ms: time from one exchange to the next.
        emergency: the last emergency message of a node, None where nothing is wrong.
        report: takes a line when drives are switched off because of one, or one holds the others up.

    Attributes:
        tripped: all are to be off until power is asked for anew.
    """

    def __init__(
        self,
        drives: dict[int, DriveFeedback],
        period_ms: float,
        emergency: Callable[[int], int | None],
        report: Report,
    ) -> None:
        self._drives, self._emergency, self._report = drives, emergency, report
        self._patience, self._tell_after = (ceil(ms / period_ms) for ms in (OPERATE_PATIENCE_MS, TELL_AFTER_MS))
        self.forget()

    def forget(self) -> None:
        """Power is not asked for: it may be, from now on."""
        self.tripped = self._may_operate = self._was_on = False
        self._reset, self._recovered = set[int](), set[int]()  # nodes whose fault was reset, and is over since then
        self._exchanges = self._apart = 0  # since power was asked for; with some in operation and others not

    @property
    def on(self) -> bool:
        """Every drive is in OPERATION ENABLED."""
        return not self._missing(DriveState.ENABLED)

    def lead(self, node: int) -> int:
        """Control word of the next step of a drive towards operation."""
        word = towards_operation(self._drives[node].status)
        if word == FAULT_RESET:
            self._reset.add(node)
        return SWITCH_ON if word == ENABLE_OPERATION and not self._may_operate else word

    def judge(self) -> None:
        """Look at what the drives have answered while power is wanted."""
        self._exchanges += 1
        if failed := self._failed():
            self.trip(self._told(failed))
            return
        self._was_on = self._was_on or (self._may_operate and self.on)
        self._may_operate = self._may_operate or not self._missing(DriveState.SWITCHED_ON)
        if self._exchanges == self._tell_after and not self._was_on:
            waited_for = self._missing(*_UP) or self._missing(DriveState.ENABLED)
            self._report(f"arm power waits for a drive: {self._told(waited_for)}")

    def trip(self, reason: str) -> None:
        """Let all drives be switched off."""
        self.tripped = True
        self._report(f"all drives are switched off: {reason}")

    # ------------------------------------------------------------------------------------------------------ inside

    def _failed(self) -> Sequence[int]:
        """Nodes for which the others must not wait, or not go on."""
        if self._was_on:
            return self._missing(DriveState.ENABLED)
        if self._may_operate:
            return self._missing(*_UP) or self._too_late()
        faulty = {node for node, drive in self._drives.items() if drive.state in _FAULTY}
        self._recovered |= self._reset - faulty
        return sorted(self._recovered & faulty)

    def _too_late(self) -> Sequence[int]:
        late = self._missing(DriveState.ENABLED)
        self._apart += 0 < len(late) < len(self._drives)
        return late if self._apart > self._patience else ()

    def _missing(self, *states: DriveState) -> Sequence[int]:
        return [node for node, drive in self._drives.items() if drive.state not in states]

    def _told(self, nodes: Sequence[int]) -> str:
        return ", ".join(self._told_of(node) for node in nodes)

    def _told_of(self, node: int) -> str:
        code = self._emergency(node)
        complaint = "" if code is None else f" (emergency message {code:#06x})"
        return f"node {node} is in {self._drives[node].state.name.replace('_', ' ')}{complaint}"
