"""Compiled code in the cache is reused exactly as long as nothing it was made of has changed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from qrobot.realtime import source_digest
from qrobot.realtime.jit import jit_disabled, kernel
from qrobot.realtime.source_digest import PACKAGE, source_stamp, sources_behind

INNER = "from qrobot.realtime.jit import kernel\n@kernel\ndef inner():\n    return {value}\n"
OUTER = INNER.replace("inner", "outer").format(value="inner()").replace("@", "from qrobot.inner import inner\n@")
MAIN = "from qrobot.outer import outer\nprint(outer(), sum(outer.stats.cache_hits.values()))\n"


def test_a_file_stands_on_what_it_imports_directly_or_not() -> None:
    behind = {path.relative_to(PACKAGE).as_posix() for path in sources_behind(PACKAGE / "hwif" / "board_memory.py")}
    assert {"hwif/board_memory.py", "hwif/registers.py", "realtime/seqlock.py", "realtime/jit.py"} <= behind
    assert not any(path.startswith("sim_board") for path in behind)


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("from qrobot.hwif.board_memory import (\n    N_WORDS,\n)", {"hwif/board_memory.py"}),
        ("    import qrobot.hwif.registers", {"hwif/registers.py"}),
        (
            "from qrobot.hwif import board_memory as m, registers",
            {"hwif/__init__.py", "hwif/board_memory.py", "hwif/registers.py"},
        ),
        ("import numpy\n# from qrobot.hwif import board_memory", set()),
    ],
)
def test_every_form_of_import_is_seen(tmp_path: Path, line: str, expected: set[str]) -> None:
    script = tmp_path / "script.py"
    script.write_text(line)
    files = {path.relative_to(PACKAGE).as_posix() for path in source_digest._imported(script)}
    assert files == expected


def test_kernels_carry_the_stamp_of_their_file() -> None:
    @kernel
    def f() -> int:
        return 1

    if not jit_disabled():
        assert f._cache._cache_file._source_stamp == source_stamp(Path(__file__))  # type: ignore[attr-defined]


def test_a_change_in_an_imported_kernel_recompiles_the_caller(tmp_path: Path) -> None:
    """In a copy of the package whose two kernels stand in two files."""
    copy = tmp_path / "qrobot"
    (copy / "realtime").mkdir(parents=True)
    for path in (PACKAGE / "__init__.py", *(PACKAGE / "realtime").glob("*.py")):
        (copy / path.relative_to(PACKAGE)).write_bytes(path.read_bytes())
    (copy / "outer.py").write_text(OUTER)

    def run(value: int) -> str:
        (copy / "inner.py").write_text(INNER.format(value=value))
        # Python's own cache would take a file of the same size and second for the same file
        environment = {"PYTHONPATH": str(tmp_path), "HOME": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
        command = [sys.executable, "-c", MAIN]
        done = subprocess.run(command, env=environment, cwd=tmp_path, check=True, stdout=subprocess.PIPE, text=True)
        return done.stdout.strip()

    assert run(11) == "11 0"
    assert run(11) == "11 1"
    assert run(22) == "22 0"
