"""The beginning of a machine's diagnostic stream."""

from __future__ import annotations

from qrobot.arcl.machine.interface import MachineSettings
from qrobot.arcl.stream import StreamStart, StreamWriter


def open_stream(settings: MachineSettings, machine: str, period_ms: float) -> StreamWriter | None:
    """The stream of a machine, None when none is wanted. Raises ConfigError: it cannot be written."""
    if settings.stream is None:
        return None
    structure = "".join("P" if slides else "R" for slides in settings.robot.prismatic)
    start = StreamStart(settings.robot.name, structure, settings.program, machine, round(period_ms * 1e3))
    return StreamWriter(settings.stream, start)
