"""Kind of a file, told by its contents: for complaints about one given, or to be written over, in another's place."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Any, Final

from qrobot.errors import ConfigError


class FileKind(Enum):
    """A kind of file: what it is called, and where it is wanted."""

    ROBOT = "a robot file", "name it as `robot` of an [[arm]] table, or with --robot"
    MODEL = "an identified model", "give it to `qrobot identify show`, or as `model` in [arm.servo], or with --model"
    DEPLOYMENT = "a deployment file", "give it where a command wants a deployment"
    CALIBRATION = "a calibration table", "name it as `calibration_table` in [arm.board]"
    FAULTS = "a file of faults", "give it to the emulated board"
    RECORDING = "a recording for identification", "read it with `qrobot.ident.compact_recording.load_recording`"
    LOG = "a log", "give it to `qrobot log` or `qrobot identify fit`"
    URDF = "a URDF", "give it to `qrobot robot import`"
    MJCF = "an MJCF model", "give it to MuJoCo"

    @property
    def called(self) -> str:
        """Name with its article."""
        return str(self.value[0])

    @property
    def wanted_at(self) -> str:
        """Advice where to give a file of this kind."""
        return str(self.value[1])


_KEYS: Final = {  # a key at the top of a document that no other kind has
    "arm": FileKind.DEPLOYMENT,
    "robot_digest": FileKind.MODEL,
    "geometry": FileKind.ROBOT,
    "transmission": FileKind.ROBOT,
    "joints": FileKind.ROBOT,
    "faults": FileKind.FAULTS,
}
_ROOTS: Final = {"robot": FileKind.URDF, "mujoco": FileKind.MJCF}  # of XML
_ROOT: Final = re.compile(r"\s*+(?>(?><\?.*?\?>|<!--.*?-->|<!DOCTYPE[^>]*>)\s*+)*+<([\w:.-]+)", re.DOTALL)
_MAGIC: Final = {b"\x89MCAP": FileKind.LOG, b"PK\x03\x04": FileKind.RECORDING}
_LOOKED_AT: Final = 1 << 20  # bytes; a document is shorter


def kind_of_document(document: Mapping[str, Any]) -> FileKind | None:
    """The kind of a parsed TOML document; None for one that is of no kind."""
    return next((kind for key, kind in _KEYS.items() if key in document), None)


def kind_of_file(path: Path) -> FileKind | None:
    """The kind of a file, whatever its name; None when it is of no kind or cannot be read."""
    try:
        with path.open("rb") as file:
            data = file.read(_LOOKED_AT)
    except OSError:
        return None
    return kind_of_content(data)


def kind_of_content(data: bytes) -> FileKind | None:
    """The kind of what stands in a file; None when it is of no kind."""
    for magic, kind in _MAGIC.items():
        if data.startswith(magic):
            return kind
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return None
    return _kind_of_text(text)


def refuse_other_kind(path: Path, wanted: FileKind) -> None:
    """Raise ConfigError when a file is clearly of another kind than `wanted`; says which, and where it belongs."""
    found = kind_of_file(path)
    if found is not None and found is not wanted:
        raise ConfigError(f"{path} is {found.called}, not {wanted.called}: {found.wanted_at}")


def _kind_of_text(text: str) -> FileKind | None:
    if root := _ROOT.match(text):
        return _ROOTS.get(root[1])
    try:
        return kind_of_document(tomllib.loads(text))
    except (ValueError, RecursionError):  # no TOML, or a number of thousands of digits
        return FileKind.CALIBRATION if _is_table(text) else None


def _is_table(text: str) -> bool:
    """Whether a text is rows of whole numbers below headers, as calibration tables are."""
    lines = [line.split() for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    rows = [words for words in lines if words[0].lower() != "joint"]
    return bool(rows) and all(len(words) == 2 and all(_is_whole(word) for word in words) for words in rows)


def _is_whole(word: str) -> bool:
    return word.lstrip("+-").isdigit()
