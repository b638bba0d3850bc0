"""The flight recorder: the cycles around each incident of a servo, in a small log of their own.

The log of a whole run may be switched off, or gigabytes long. The loop does nothing for this but write its ring.
Whoever looks now and then - the main thread of the servo - saves the seconds around an incident once they are over,
with the incident attached. A disk that refuses costs that file, and is told. The report must neither wait nor raise.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

import numpy as np

from qrobot.config import Robot
from qrobot.errors import LinkError, LogError, QRobotError
from qrobot.faultcodes import FaultCode
from qrobot.fences.told_fences import ToldFences
from qrobot.log.arm_view import Point
from qrobot.log.follow import fresh_path
from qrobot.log.header import Attachment, LogHeader
from qrobot.log.read import Log
from qrobot.log.record import write_log
from qrobot.model.arm_shape import NO_TOOL
from qrobot.servo.memory.law_history import JournalReader, LawInForce
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.servo_memory import ServoInfo, journal_base
from qrobot.servo.memory.stop_record import Incident
from qrobot.servo.memory.telemetry import READ_ROWS, Rows, TelemetryReader

BEFORE_NS: Final = 10_000_000_000
AFTER_NS: Final = 500_000_000
LONGEST_NS: Final = 2_000_000_000  # from the first of several incidents
SLACK_ROWS: Final = 100  # cycles between the look at the time and the look at the ring
KEEP: Final = 20  # files of an arm
ATTACHMENT: Final = "incidents.json"


class FlightRecorder:
    """Saves what a servo did around its incidents.

    Args:
        folder: where the files go, made when the first is written; `keep` of them stay, the newest.
        arm: instance name, the beginning of each file's name; the code and the time (UTC) follow.
        header_of: header of a log of the servo with these facts.
        report: takes one line for people for each file, and for each that the disk refused.
        robot, tool_m, fences: the arm, so that it can be looked at; see `ArmView`.
        attachments: files to carry beside the incident, such as the fences in force.
    """

    def __init__(
        self,
        folder: Path,
        arm: str,
        header_of: Callable[[ServoInfo], LogHeader],
        report: Callable[[str], None],
        keep: int = KEEP,
        robot: Robot | None = None,
        attachments: Iterable[Attachment] = (),
        tool_m: Point = NO_TOOL,
        fences: ToldFences | None = None,
    ) -> None:
        self._folder, self._arm, self._header_of, self._report, self._keep = folder, arm, header_of, report, keep
        self._robot, self._tool_m, self._fences = robot, tool_m, fences
        self._attachments = tuple(attachments)
        self._seen = 0
        self._waiting: list[Incident] = []

    def look(self, mailbox: ServoMailbox, incident: Incident | None, ended: bool = False) -> None:
        """Note a new incident, and save those whose time is over; all of them when the servo has `ended`."""
        if incident is not None and incident.number > self._seen:
            self._seen = incident.number
            self._waiting.append(incident)
        if self._waiting and (ended or self._is_due(mailbox)):
            incidents, self._waiting = self._waiting, []
            self._save(mailbox, incidents)

    def _is_due(self, mailbox: ServoMailbox) -> bool:
        """True when enough has followed the newest incident, or much the first."""
        first, last = self._waiting[0], self._waiting[-1]
        with suppress(LinkError):  # the loop was interrupted while it wrote: the next look will do
            return mailbox.snapshot().t_ns >= min(last.t_ns + AFTER_NS, first.t_ns + LONGEST_NS)
        return False

    def _save(self, mailbox: ServoMailbox, incidents: Sequence[Incident]) -> None:
        code = FaultCode(incidents[-1].code).name
        data = json.dumps([incident.to_dict() for incident in incidents], indent=1).encode()
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            path = fresh_path(self._folder, f"{self._arm}-{code}")
            rows = _rows_since(mailbox, incidents[0].t_ns - BEFORE_NS)
            attachments = [Attachment(ATTACHMENT, data, "application/json"), *self._attachments]
            header, looks = self._header_of(mailbox.info), (self._robot, self._tool_m, self._fences)
            write_log(path, rows, header, attachments, None, _laws(mailbox), *looks)
            self._thin_out(path)
        except (QRobotError, OSError) as error:
            self._report(f"the cycles around {code} are not saved: {error}")
        else:
            self._report(f"the {np.ptp(rows['t_ns']) * 1e-9:.1f} s around {code} are saved: `qrobot log info {path}`")

    def _thin_out(self, newest: Path) -> None:
        """Remove the oldest files. The one just written stays: by the clock, which may be set back, it may be old."""
        others = [path for path in self._folder.glob(f"{self._arm}-*.mcap") if path != newest]
        others.sort(key=lambda path: path.stat().st_mtime_ns)
        for old in others[: max(0, len(others) + 1 - self._keep)]:
            old.unlink()


def _rows_since(mailbox: ServoMailbox, t_ns: int) -> Rows:
    """Rows that the ring still has of the cycles from `t_ns` on."""
    info = mailbox.info
    reader = TelemetryReader(mailbox.words, info.telemetry_base, info.telemetry_capacity, info.n)
    rows_since = (
        mailbox.snapshot().t_ns - t_ns
    ) // info.period_ns + SLACK_ROWS  # the ring holds a minute: not all of it
    reader.next_row = max(reader.next_row, reader.next_row + reader.waiting - rows_since)
    blocks = [reader.layout.empty(0)]
    for _ in range(math.ceil(info.telemetry_capacity / READ_ROWS)):  # what the ring holds, however its head counts on
        blocks.append(reader.read())
    rows = np.concatenate(blocks)
    return np.asarray(rows[rows["t_ns"] >= t_ns])


def _laws(mailbox: ServoMailbox) -> list[LawInForce]:
    n = mailbox.info.n
    return list(JournalReader(mailbox.words, journal_base(n), n).read())


def incidents_of(log: Log) -> list[Incident]:
    """Incidents for which a flight recorder's log was saved; none of any other. Raises LogError when that is
    damaged."""
    try:
        return [Incident.from_dict(fields) for fields in json.loads(log.attachments.get(ATTACHMENT, b"[]"))]
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise LogError(f"{ATTACHMENT} in {log.path} is damaged: {error}") from None
