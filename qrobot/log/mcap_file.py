"""One log file: rows of telemetry as ROS 2 messages in MCAP, by foxglove-sdk.

A message is a row with a four-byte header in front (see `servo.memory.telemetry`); its log time is the wall clock at
the time of its cycle, which on the servo's monotonic clock stands in the row. Topic /servo/tick carries the
rows, /servo/law what law is in force, /servo/log_status what was lost; see `arm_view` for the others. A chunk is closed
at each flush, and a reader can use every closed chunk of a file that was cut short (the MCAP specification, "Chunk").
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Final

import numpy as np
from foxglove import Channel, Context, Schema, open_mcap
from foxglove.mcap import MCAPCompression, MCAPWriteOptions

from qrobot.config import Robot
from qrobot.fences.told_fences import ToldFences
from qrobot.log import law_message
from qrobot.log.arm_view import ArmView, Point
from qrobot.log.buffered_file import BufferedFile
from qrobot.log.header import METADATA_NAME, Attachment, LogHeader
from qrobot.log.status import SCHEMA_NAME, LogStatus
from qrobot.log.topics import LAW_TOPIC, STATUS_TOPIC, TICK_TOPIC
from qrobot.model.arm_shape import NO_TOOL
from qrobot.servo.memory.law_history import LawInForce
from qrobot.servo.memory.telemetry import CDR_HEADER, Rows

_CDR_WORD: Final = int.from_bytes(CDR_HEADER, "little")


class LogStream:
    """The channels of one log, shared by its parts."""

    def __init__(
        self,
        header: LogHeader,
        robot: Robot | None = None,
        tool_m: Point = NO_TOOL,
        fences: ToldFences | None = None,
    ) -> None:
        self.context = Context()
        self._offset_ns = header.wall_offset_ns
        self._view = None if robot is None else ArmView(self.context, robot, header.wall_offset_ns, tool_m, fences)
        layout = header.layout
        self.tick = Channel(
            TICK_TOPIC,
            message_encoding="cdr",
            context=self.context,
            schema=Schema(name=layout.schema_name, encoding="ros2msg", data=layout.ros2msg().encode()),
            metadata={
                "robot": header.robot,
                "n": str(header.n),
                "rate_hz": f"{header.rate_hz:g}",
                "joints": " ".join(header.joint_names),
            },
        )
        self.status = Channel(
            STATUS_TOPIC,
            message_encoding="cdr",
            context=self.context,
            schema=Schema(name=SCHEMA_NAME, encoding="ros2msg", data=LogStatus.ros2msg().encode()),
        )
        law, definition = law_message.schema_name(header.n), law_message.ros2msg(header.n)
        self.law = Channel(
            LAW_TOPIC,
            message_encoding="cdr",
            context=self.context,
            schema=Schema(name=law, encoding="ros2msg", data=definition.encode()),
        )

    def log_rows(self, rows: Rows) -> None:
        """One message per row, shape (m,), to the open part."""
        framed = np.empty(rows.size, dtype=[("cdr", "<u4"), ("row", rows.dtype)])
        framed["cdr"], framed["row"] = _CDR_WORD, rows
        size, data, log = framed.dtype.itemsize, framed.tobytes(), self.tick.log
        for i, log_time in enumerate((rows["t_ns"] + self._offset_ns).tolist()):
            log(data[i * size : (i + 1) * size], log_time=log_time)
        if self._view is not None:  # behind all rows: those of a chunk are read in one piece
            self._view.log_rows(rows)

    def begin_part(self) -> None:
        """Direct everything logged from now on to another file."""
        if self._view is not None:
            self._view.begin_part()

    def log_status(self, status: LogStatus) -> None:
        """One message to the open part."""
        self.status.log(status.to_bytes(), log_time=status.t_ns + self._offset_ns)

    def log_law(self, law: LawInForce, begin_ns: int) -> None:
        """One message to the open part, at the earliest at `begin_ns`: a log's time does not begin before its rows."""
        self.law.log(law_message.to_bytes(law), log_time=max(law.t_ns, begin_ns) + self._offset_ns)


class LogPart:
    """One file of a log; open at most one at a time."""

    def __init__(self, stream: LogStream, path: Path, header: LogHeader, attachments: Iterable[Attachment]) -> None:
        self.spool = BufferedFile(path)
        options = MCAPWriteOptions(
            profile="ros2", compression=MCAPCompression.Zstd, disable_seeking=True, compression_threads=0
        )
        self._writer = open_mcap(self.spool, context=stream.context, writer_options=options)
        self._writer.write_metadata(METADATA_NAME, header.to_metadata())
        for item in attachments:
            self._writer.attach(log_time=0, create_time=0, name=item.name, media_type=item.media_type, data=item.data)
        self.spool.drain()  # so that a reader knows at once what this is

    def flush(self) -> None:
        """Close the chunk and offer it to the disk."""
        self._writer.flush()
        self.spool.drain()

    def close(self) -> None:
        """Write the summary and close the file."""
        self._writer.close()
        self.spool.close()
