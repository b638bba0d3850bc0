"""The message that says which law is in force, one for each entry of the servo's journal.

The fields of fixed length come first, so only the texts at the end follow CDR's rules for strings: from a multiple of
four bytes on the length with the closing zero, four bytes, then the bytes (OMG DDS-XTYPES 7.4).
"""

from __future__ import annotations

import struct
from typing import Final

import numpy as np

from qrobot.servo.memory.law_history import LawInForce
from qrobot.servo.memory.telemetry import CDR_HEADER

_HEAD: Final = struct.Struct("<qq")  # t_ns, tick
_LENGTH: Final = struct.Struct("<I")


def schema_name(n: int) -> str:
    """ROS 2 type of the message; one type per joint count, since its arrays have fixed length."""
    return f"qrobot_msgs/msg/LawInForce{n}"


def ros2msg(n: int) -> str:
    """ROS 2 message definition."""
    return (
        "int64 t_ns  # time of the first cycle under this law, ns on the servo's clock; 0 from the start\n"
        "int64 tick  # its number\n"
        f"float64[{n}] kp  # N m/rad or N/m\n"
        f"float64[{n}] kv  # N m s/rad or N s/m\n"
        f"float64[{n}] inertia  # kg m2 or kg\n"
        "string law\n"
        "string settings  # of the law, such as frequency=8 damping=1\n"
        "string signals  # names of its numbers in the rows, in their order\n"
        "string program_signals  # names of the program's numbers, likewise\n"
    )


def to_bytes(entry: LawInForce) -> bytes:
    """The CDR message."""
    gains = np.array([entry.kp, entry.kv, entry.inertia], dtype="<f8").tobytes()
    message = CDR_HEADER + _HEAD.pack(entry.t_ns, entry.tick) + gains
    for text in (entry.law, entry.settings, entry.signals, entry.program_signals):
        message += bytes(-len(message) % _LENGTH.size) + _LENGTH.pack(len(text.encode()) + 1) + text.encode() + b"\0"
    return message


def from_bytes(message: bytes | memoryview, n: int) -> LawInForce:
    """Inverse of `to_bytes` for `n` joints. Raises ValueError or struct.error for a message that is damaged."""
    at = len(CDR_HEADER)
    t_ns, tick = _HEAD.unpack_from(message, at)
    gains = np.frombuffer(message, dtype="<f8", count=3 * n, offset=at + _HEAD.size)
    law, at = _text(message, at + _HEAD.size + gains.nbytes)
    settings, at = _text(message, at)
    signals, at = _text(message, at) if at < len(message) else ("", at)  # a log of before has none
    program = _text(message, at)[0] if at < len(message) else ""
    kp, kv, inertia = (tuple(row) for row in gains.reshape(3, n).tolist())
    return LawInForce(t_ns, tick, law, settings, kp, kv, inertia, signals, program)


def _text(message: bytes | memoryview, at: int) -> tuple[str, int]:
    """The string that stands at or shortly behind `at`, and where the next may."""
    at += -at % _LENGTH.size
    (length,) = _LENGTH.unpack_from(message, at)
    at += _LENGTH.size
    return bytes(message[at : at + length]).rstrip(b"\0").decode(), at + length
