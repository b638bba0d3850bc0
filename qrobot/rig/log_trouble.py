"""A log whose disk takes nothing more, or that loses cycles: told where `qrobot up` runs, too, once and at its end."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from qrobot.log.status import LOG_IS_BEHIND, LOG_IS_CUT
from qrobot.report import Report
from qrobot.rig.processes import Child


@dataclass
class LogTrouble:
    """Looks at what processes have printed last."""

    report: Report
    _told: set[str] = field(default_factory=set)

    def look(self, children: Iterable[Child]) -> None:
        """Tell of each process's log that is behind, the first time."""
        for child in children:
            if child.name not in self._told and (line := child.complaint()).startswith(LOG_IS_BEHIND):
                self._told.add(child.name)
                self.report(f"{child.name}: {line}; more of it stands in {child.output}")

    def look_back(self, children: Iterable[Child]) -> None:
        """Tell of each log, of processes that have been ended, to whose end the disk has not come."""
        for child in children:
            if (line := child.complaint()).startswith(LOG_IS_CUT):
                self.report(f"{child.name}: {line}")
