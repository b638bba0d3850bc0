"""The diagnostic stream: everything that was sent to an arm, as a file (Corke & Kirkham, section 4)."""

from qrobot.arcl.stream.layout import RecordKind
from qrobot.arcl.stream.reader import Stream, StreamRecord, read_stream
from qrobot.arcl.stream.start import StreamStart
from qrobot.arcl.stream.tables import cartesian_table, joint_table, write_table
from qrobot.arcl.stream.text import stream_lines
from qrobot.arcl.stream.writer import StreamWriter

__all__ = [
    "RecordKind",
    "Stream",
    "StreamRecord",
    "StreamStart",
    "StreamWriter",
    "cartesian_table",
    "joint_table",
    "read_stream",
    "stream_lines",
    "write_table",
]
