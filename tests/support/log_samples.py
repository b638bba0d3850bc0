"""Logs for tests: rows with recognisable contents, rings they come from, disks that do not want them."""

from __future__ import annotations

import errno
import os
from typing import Any

import numpy as np
import pytest

from qrobot.faultcodes import NO_JOINT
from qrobot.log.header import LogHeader
from qrobot.modecodes import Mode
from qrobot.servo.memory.telemetry import Rows, TelemetryLayout, TelemetryReader, append_row, ring_words

PERIOD_NS = 250_000
START_NS = 5_000_000_000


def make_header(n: int = 6, period_ns: int = PERIOD_NS) -> LogHeader:
    return LogHeader(robot="sample", joint_names=tuple(f"joint{j + 1}" for j in range(n)), period_ns=period_ns)


def make_rows(n_rows: int, n: int = 6, first: int = 0) -> Rows:
    """Rows `first`.. of a run: every field of every row differs from its neighbours."""
    rows = TelemetryLayout(n).empty(n_rows)
    k = np.arange(first, first + n_rows)
    rows["tick"], rows["t_ns"] = k, START_NS + k * PERIOD_NS
    rows["late_ns"], rows["busy_ns"], rows["mode"] = 1000 + k % 7, 2000 + k % 11, Mode.TRACKING
    for i, name in enumerate(("q_ref", "v_ref", "a_ref", "q", "v", "tau")):
        rows[name] = np.sin(1e-3 * k[:, None] + np.arange(n) + i)
    rows["counts"], rows["dac"] = k[:, None] + np.arange(n), 2048 + np.arange(n)
    rows["event_joint"] = NO_JOINT
    return rows


class Ring:
    """A ring with its writer's end."""

    def __init__(self, capacity: int = 1024, n: int = 6) -> None:
        self.n, self.capacity = n, capacity
        self.row_words = TelemetryLayout(n).row_words
        self.words = np.zeros(ring_words(self.row_words, capacity), dtype=np.int64)

    def append(self, rows: Rows) -> None:
        for row in rows.view(np.int64).reshape(rows.size, self.row_words):
            append_row(self.words, 0, self.capacity, self.row_words, row)

    def reader(self) -> TelemetryReader:
        return TelemetryReader(self.words, 0, self.capacity, self.n)


class FullDisk:
    """`os.write` of a disk that takes `room` more bytes."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, room: int) -> None:
        self.room = room
        self._write = os.write
        monkeypatch.setattr(os, "write", self.write)

    def write(self, fd: int, data: Any) -> int:
        if self.room == 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        done = self._write(fd, bytes(data[: self.room]))
        self.room -= done
        return done
