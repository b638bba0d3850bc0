"""The contents that records of each kind can have: a checksum that is right does not make numbers of bytes."""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arcl.stream.layout import RecordKind
from qrobot.arrays import Floats

_POSE_NUMBERS: Final = 12
_TURN_ERROR: Final = 1e-6  # [A] of the products of a pose's axes; writers are exact to 1e-15
_NUMBER_BYTES: Final = 8


def content_fault(kind: int, content: bytes, n: int) -> str:
    """A word on what a record of an arm with `n` joints cannot be; empty when nothing is wrong with it."""
    if kind == RecordKind.START:
        return "a second START"
    if kind == RecordKind.EVENT:
        return _numbers_fault(kind, content[:_NUMBER_BYTES], 1)
    wanted = {
        RecordKind.JOINTS: n, RecordKind.MEASURED: n, RecordKind.CARTESIAN: _POSE_NUMBERS, RecordKind.GRIPPER: 2,
        RecordKind.OUTPUT: 3, RecordKind.ANALOG: 2,
    }  # fmt: skip
    for known, count in wanted.items():
        if kind == known:
            return _numbers_fault(kind, content, count)
    return ""


def _numbers_fault(kind: int, content: bytes, count: int) -> str:
    name = RecordKind(kind).name
    if len(content) != _NUMBER_BYTES * count:
        return f"{len(content)} bytes are no {name}, which has {count} numbers"
    numbers = np.frombuffer(content, dtype="<f8")
    if not np.isfinite(numbers).all():
        return f"a {name} with numbers that are not finite"
    if kind == RecordKind.CARTESIAN and not _is_rigid(numbers):
        return f"a {name} that is no rigid transform"
    return ""


def _is_rigid(numbers: Floats) -> bool:
    axes = numbers[:9].reshape(3, 3)
    if not np.abs(axes).max() <= 1.0 + _TURN_ERROR:
        return False
    return bool(np.abs(axes @ axes.T - np.eye(3)).max() <= _TURN_ERROR)
