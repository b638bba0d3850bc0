"""Keep recording one arm while its servo comes and goes: each servo process gets a log of its own.

A servo that has died leaves its ring in shared memory, so its last cycles are still written down. Its successor takes
the memory over and raises the generation; from that moment nothing of the old ring is read any more.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from qrobot.errors import LinkError, LinkMismatch
from qrobot.log.record import LogRecorder, RowSink
from qrobot.log.status import LOG_IS_BEHIND, LOG_IS_CUT, LogStatus
from qrobot.log.topics import STAMP
from qrobot.realtime.shared_memory import SharedMemory
from qrobot.report import Report
from qrobot.servo.memory.law_history import JournalReader
from qrobot.servo.memory.servo_memory import ServoInfo, attach_servo_memory, journal_base, servo_info
from qrobot.servo.memory.telemetry import TelemetryReader

POLL_S: Final = 0.05  # a ring holds a thousand times as much; a look at it costs as much as twenty rows
LOOK_NS: Final = 200_000_000  # how often to look whether the servo lives
REPORT_NS: Final = 1_000_000_000
LEFT_OUT: Final = 4  # [A] of a full ring one part in so many, the oldest, may be overwritten before it is read

OpenLog = Callable[[ServoInfo, int], RowSink]  # the servo and its process id


@dataclass
class _Session:
    """One servo process being recorded."""

    segment: SharedMemory
    generation: int
    recorder: LogRecorder
    name: str


def _reader(segment: SharedMemory, info: ServoInfo) -> TelemetryReader:
    """A reader from the oldest row on that will still be there when the log is open."""
    reader = TelemetryReader(segment.words, info.telemetry_base, info.telemetry_capacity, info.n)
    most = info.telemetry_capacity - info.telemetry_capacity // LEFT_OUT
    reader.next_row += max(0, reader.waiting - most)
    return reader


class ServoFollower:
    """Records the servos of one arm, one after the other.

    Args:
        arm: instance name.
        open_log: opens the log of a servo that has just been found.
        report: takes one line for people.
        from_now: leave out what is in the ring already.
    """

    def __init__(self, arm: str, open_log: OpenLog, report: Report, from_now: bool = False) -> None:
        self._arm, self._open_log, self._report, self._from_now = arm, open_log, report, from_now
        self._session: _Session | None = None
        self._look_at_ns = self._report_at_ns = 0
        self._reported = LogStatus()
        self._mismatch = ""

    @property
    def recording(self) -> bool:
        """True while there is a servo to record."""
        return self._session is not None

    def step(self, now_ns: int) -> None:
        """Write down what is new. Raises what `open_log` raises."""
        looking = now_ns >= self._look_at_ns
        if looking:
            self._look_at_ns = now_ns + LOOK_NS
        if self._session is None:
            if looking:
                self._begin()
            return
        taken_over = int(self._session.segment.header.generation) != self._session.generation
        gone = looking and not (self._session.segment.is_current and self._session.segment.owner_alive)
        if taken_over or gone:
            self._end(drain=not taken_over)
            return
        self._session.recorder.poll(now_ns)
        self._complain(self._session.recorder, now_ns)

    def close(self) -> None:
        """End the log that is being written."""
        if self._session is not None:
            self._end(drain=True)

    def _begin(self) -> None:
        try:
            segment = attach_servo_memory(self._arm)
        except LinkMismatch as error:
            if str(error) != self._mismatch:
                self._mismatch = str(error)
                self._report(f"the servo of {self._arm} is not recorded: {error}")
            return
        except LinkError:
            return
        self._mismatch = ""
        info = servo_info(segment.words)
        if not (info.ready and segment.owner_alive):
            segment.close()
            return
        writer = self._open_log(info, int(segment.header.owner_pid))
        reader = _reader(segment, info)
        if self._from_now:
            reader.next_row += reader.waiting
        journal = JournalReader(segment.words, journal_base(info.n), info.n)
        self._session = _Session(segment, info.generation, LogRecorder(reader, writer, journal), writer.heading)
        self._reported = LogStatus()
        self._report(f"the servo of {self._arm} is {writer.heading}")

    def _end(self, drain: bool) -> None:
        assert self._session is not None
        recorder = self._session.recorder
        recorder.close(drain)
        counts = f"{recorder.status.rows} cycles, {recorder.status.lost} lost"
        self._report(f"the servo of {self._arm} ends, {self._session.name}: {counts}")
        if recorder.backlog:
            self._report(
                f"{LOG_IS_CUT} {recorder.backlog} bytes ({recorder.last_error}): "
                "`qrobot log info` tells how far the log reaches"
            )
        self._session.segment.close()
        self._session = None
        self._look_at_ns = 0

    def _complain(self, recorder: LogRecorder, now_ns: int) -> None:
        """Tell of a disk that refuses, or of lost rows, in at most one line a second."""
        status = recorder.status
        trouble = (status.lost, status.disk_errors) != (self._reported.lost, self._reported.disk_errors)
        if trouble and now_ns >= self._report_at_ns:
            self._report_at_ns = now_ns + REPORT_NS
            self._reported = status
            disk = f", {status.disk_errors} refusals by the disk ({recorder.last_error})" if status.disk_errors else ""
            self._report(f"{LOG_IS_BEHIND}: {status.lost} cycles lost{disk}")


def follow(follower: ServoFollower, stop: threading.Event) -> None:
    """Run a follower on the wall clock until `stop` is set, and end its log."""
    try:
        while not stop.wait(POLL_S):
            follower.step(time.monotonic_ns())
    finally:
        follower.close()


def log_paths(target: Path, arm: str) -> Iterator[Path]:
    """Files for one log after the other: in directory `target`, or first the .mcap file `target` and then beside it."""
    directory = target
    if target.suffix == ".mcap":
        directory = target.parent
        directory.mkdir(parents=True, exist_ok=True)
        yield target
    directory.mkdir(parents=True, exist_ok=True)
    while True:
        yield fresh_path(directory, arm)


def fresh_path(directory: Path, arm: str, now: datetime | None = None) -> Path:
    """A file name that tells arm and time (UTC) and is not taken: DIR/ARM-20261121T093000Z.mcap."""
    stamp = (now or datetime.fromtimestamp(time.time(), UTC)).strftime(STAMP)
    path, copies = directory / f"{arm}-{stamp}.mcap", 1
    while path.exists():
        copies += 1
        path = directory / f"{arm}-{stamp}-{copies}.mcap"
    return path
