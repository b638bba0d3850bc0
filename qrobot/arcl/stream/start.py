"""The first record of a stream: magic number, names of manipulator, kinematic structure and program."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final

from qrobot.arcl.stream.layout import MAGIC, VERSION
from qrobot.errors import LogError

_FIXED: Final = struct.Struct("<8sIIQ")
_LONGEST: Final = 255  # bytes of a name


@dataclass(frozen=True)
class StreamStart:
    """The first record: robot, program and machine of a stream.

    Attributes:
        robot: name of the manipulator.
        structure: kinds of its joints, base to flange: R turns, P slides.
        program: that made it.
        machine: the machine layer.
        period_us: sample period.
    """

    robot: str
    structure: str
    program: str
    machine: str
    period_us: int

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.structure)

    def encode(self) -> bytes:
        """The content of the record: each name behind its length in one byte."""
        names = (name.encode()[:_LONGEST] for name in (self.robot, self.structure, self.program, self.machine))
        return _FIXED.pack(MAGIC, VERSION, self.n, self.period_us) + b"".join(
            bytes([len(name)]) + name for name in names
        )


def decode_start(content: bytes, label: str) -> StreamStart:
    """Read what `encode` made. Raises LogError: no stream, or of another version."""
    if len(content) < _FIXED.size or not content.startswith(MAGIC):
        raise LogError(f"{label}: not an ARCL stream")
    _, version, n, period_us = _FIXED.unpack_from(content)
    if version != VERSION:
        raise LogError(f"{label}: an ARCL stream of version {version}; this program reads version {VERSION}")
    robot, structure, program, machine = _names(content[_FIXED.size :], label)
    if len(structure) != n or not n or not period_us:
        raise LogError(f"{label}: its first record is damaged: {n} joints, structure {structure!r}")
    return StreamStart(robot, structure, program, machine, period_us)


def _names(data: bytes, label: str) -> tuple[str, str, str, str]:
    names: list[str] = []
    for _ in range(4):
        length = data[0] if data else 1
        if len(data) < 1 + length:
            raise LogError(f"{label}: its first record is damaged: a name is cut short")
        names.append(data[1 : 1 + length].decode(errors="replace"))
        data = data[1 + length :]
    return names[0], names[1], names[2], names[3]
