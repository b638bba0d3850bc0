"""Texts with a mark of the byte order in front, as editors of Windows write them, are read like those without."""

from __future__ import annotations

from codecs import BOM_UTF8
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from qrobot.cli.program_settings import settings_of
from qrobot.cli.teach import _script
from qrobot.config import deployment_path, robot_path
from qrobot.config.document import read_document
from qrobot.config.kinds import kind_of_file
from qrobot.rccl.database import DataBase
from qrobot.val.source import load_source, source_text

PROGRAM = '# /// script\n# [tool.qrobot]\n# scene = "crank"\n# ///\n'
PLACES = "P1 1 2 3 0 0 0\n"
VAL = ".PROGRAM main\n    x = 1\n.END\n"
READERS: list[tuple[bytes, Callable[[Path], Any]]] = [
    (VAL.encode(), load_source),
    (VAL.encode(), source_text),
    (deployment_path("emulator").read_bytes(), read_document),
    (deployment_path("emulator").read_bytes(), kind_of_file),
    (robot_path("puma560").read_bytes(), read_document),
    (PLACES.encode(), lambda path: DataBase(path).get("P1").value.tolist()),
    (b"world dz -20\n", _script),
    (PROGRAM.encode(), settings_of),
]


@pytest.mark.parametrize(
    ("text", "read"), READERS, ids=["v2", "v2 text", "deployment", "kind", "robot", "places", "teach", "program"]
)
def test_a_mark_of_the_byte_order_is_no_part_of_a_text(
    text: bytes, read: Callable[[Path], Any], tmp_path: Path
) -> None:
    plain, marked = tmp_path / "plain", tmp_path / "marked"
    plain.write_bytes(text)
    marked.write_bytes(BOM_UTF8 + text)
    assert read(marked) == read(plain)
    assert read(plain)
