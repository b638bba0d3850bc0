"""Messages in the encoding of protocol buffers, read by the schema that stands beside them in an MCAP file.

Facts of the format: the pages "Encoding" of protobuf.dev, and descriptor.proto, in which a schema itself is encoded.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

SCALARS = {1: "<d", 2: "<f", 6: "<Q", 7: "<I", 15: "<i", 16: "<q"}  # by type, those of fixed length
STRING, MESSAGE, BYTES, REPEATED = 9, 11, 12, 3


def _varint(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = data[at]
        value, shift, at = value | (byte & 0x7F) << shift, shift + 7, at + 1
        if byte < 0x80:
            return value, at


def _fields(data: bytes) -> Iterator[tuple[int, Any]]:
    """Number and raw value of each field: an integer, or bytes."""
    at = 0
    while at < len(data):
        key, at = _varint(data, at)
        kind = key & 7
        if kind == 0:
            value, at = _varint(data, at)
            yield key >> 3, value
            continue
        size = 8 if kind == 1 else 4
        if kind == 2:
            size, at = _varint(data, at)
        yield key >> 3, data[at : at + size]
        at += size


def _all(data: bytes, number: int) -> list[Any]:
    return [value for each, value in _fields(data) if each == number]


class Schema:
    """The messages of a FileDescriptorSet."""

    def __init__(self, descriptors: bytes) -> None:
        self._messages: dict[str, dict[int, tuple[str, int, int, str]]] = {}
        for file in _all(descriptors, 1):
            package = b"".join(_all(file, 2)).decode()
            for message in _all(file, 4):
                self._add(package, message)

    def _add(self, scope: str, message: bytes) -> None:
        name = f"{scope}.{_all(message, 1)[0].decode()}"
        self._messages[name] = {}
        for field in _all(message, 2):
            told = dict(_fields(field))
            kind = told.get(6, b"").decode().lstrip(".")
            self._messages[name][told[3]] = told[1].decode(), told[4], told[5], kind
        for nested in _all(message, 3):
            self._add(name, nested)

    def decode(self, name: str, data: bytes) -> SimpleNamespace:
        """A message; what is not there is 0, empty or None."""
        fields = self._messages[name]
        made = {field: [] if label == REPEATED else self._nothing(kind) for field, label, kind, _ in fields.values()}
        for number, raw in _fields(data):
            field, label, kind, of = fields[number]
            value = self._value(kind, of, raw)
            made[field] = [*made[field], value] if label == REPEATED else value
        return SimpleNamespace(**made)

    def _nothing(self, kind: int) -> Any:
        return {STRING: "", BYTES: b"", MESSAGE: None}.get(kind, 0)

    def _value(self, kind: int, of: str, raw: Any) -> Any:
        if kind == MESSAGE:
            return self.decode(of, raw)
        if kind in SCALARS:
            return struct.unpack(SCALARS[kind], raw)[0]
        return raw.decode() if kind == STRING else raw
