"""Completeness of a log: a small message that the recorder writes with every flush."""

from __future__ import annotations

from dataclasses import astuple, dataclass, fields
from typing import Final

import numpy as np

from qrobot.servo.memory.telemetry import CDR_HEADER

SCHEMA_NAME: Final = "qrobot_msgs/msg/LogStatus"

LOG_IS_BEHIND: Final = "the log is behind"
"""So begins what a recorder says whose disk refuses, or that loses cycles."""
LOG_IS_CUT: Final = "the disk did not take its last"
"""So begins what it says at its end of bytes that were still to be written."""


@dataclass(frozen=True)
class LogStatus:
    """Completeness of a log, from its beginning up to `t_ns`.

    Attributes:
        rows: written so far, over all parts.
        lost: rows the recorder came too late for.
        disk_errors: times the disk refused to take data.
        backlog_bytes: bytes that waited for the disk.
    """

    t_ns: int = 0
    rows: int = 0
    lost: int = 0
    disk_errors: int = 0
    backlog_bytes: int = 0

    def to_bytes(self) -> bytes:
        """The CDR message."""
        return CDR_HEADER + np.array(astuple(self), dtype="<i8").tobytes()

    @classmethod
    def from_bytes(cls, message: bytes | memoryview) -> LogStatus:
        """Inverse of `to_bytes`. Raises ValueError for a message that is too short."""
        values = np.frombuffer(message, dtype="<i8", count=len(fields(cls)), offset=len(CDR_HEADER))
        return cls(*values.tolist())

    @classmethod
    def ros2msg(cls) -> str:
        """ROS 2 message definition."""
        return "".join(f"int64 {field.name}\n" for field in fields(cls))
