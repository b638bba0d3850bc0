"""Structures of programs in C lie where the engine reads them, and a compiler that puts them elsewhere is refused."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from qrobot.arcl.c import cell, objects
from qrobot.c_transport import message
from qrobot.cli import toolchain
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.rccl.c.shared import CHG, HOW
from tests.support.c_programs import needs_compiler

HEADERS = {
    "rccl.h": toolchain.INCLUDE,
    "multi": toolchain.MULTI_INCLUDE,
    "arcl.h": toolchain.ARCL_INCLUDE,
}

pytestmark = needs_compiler


def fields_of(struct: str, layout: np.dtype[np.void]) -> str:
    """Assertions that a structure of C is laid out as one of numpy."""
    places = (f"offsetof({struct}, {name}) == {field[1]}" for name, field in (layout.fields or {}).items())
    return "".join(f'_Static_assert({place}, "");\n' for place in (*places, f"sizeof({struct}) == {layout.itemsize}"))


def compiles(text: str, folder: Path, *flags: str) -> subprocess.CompletedProcess[str]:
    (folder / "it.c").write_text(text)
    folders = (toolchain.INCLUDE, toolchain.ARCL_INCLUDE, toolchain.SOURCES)
    command = [*toolchain.compiler(), "-std=gnu99", "-w", *flags, *(f"-I{each}" for each in folders), "-c", "it.c"]
    return subprocess.run(command, cwd=folder, check=False, capture_output=True, text=True)


def test_the_engine_reads_how_and_chg_where_a_program_has_them(tmp_path: Path) -> None:
    text = fields_of("struct rccl_how", HOW) + fields_of("struct rccl_chg", CHG)
    done = compiles(f'#include "rccl.h"\n#include <stddef.h>\n{text}', tmp_path)
    assert done.returncode == 0, done.stderr


def test_the_engine_reads_messages_and_objects_of_arcl_where_a_program_has_them(tmp_path: Path) -> None:
    places = {
        "sizeof(struct message)": message.SIZE,
        "offsetof(Trans, t_n)": objects._FIELDS,
        "offsetof(Motion, t0)": objects._T0,
        "offsetof(Motion, code)": objects._CODE,
        "sizeof(Feedback)": 8 * (3 + 4 * cell._JOINTS),
    }
    text = "".join(f'_Static_assert({what} == {place}, "{what}");\n' for what, place in places.items())
    done = compiles(f'#include "arcl.h"\n#include "channel.h"\n{text}', tmp_path)
    assert done.returncode == 0, done.stderr
    source = (toolchain.ARCL_SOURCES / "arcl_call.c").read_text()
    assert f"ARCL_LAYOUT(struct cell, time, {cell._TIME});" in source
    assert f"ARCL_LAYOUT(struct cell, feedback, {cell._FEEDBACK});" in source


@pytest.mark.parametrize("header", HEADERS)
def test_a_compiler_that_lays_structures_out_otherwise_is_told_what_to_do(header: str, tmp_path: Path) -> None:
    text = f'#include "{HEADERS[header] / header.replace("multi", "rccl.h")}"\n'
    assert compiles(text, tmp_path, "-fshort-enums").returncode == 0
    done = compiles(text, tmp_path, "-fpack-struct=2")
    assert done.returncode != 0
    assert "compile for 64 bits, without options that change layouts" in done.stderr


@pytest.mark.parametrize("option", ["-m32", "-mx32", "-fpack-struct"])
@pytest.mark.parametrize("by_variable", [False, True])
def test_an_option_that_changes_layouts_is_refused_before_anything_is_compiled(
    option: str, by_variable: bool, tmp_path: Path, capfd, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "it.c").write_text('#include "rccl.h"\nmain() {}\n')
    if by_variable:
        monkeypatch.setenv("CC", f"{os.environ.get('CC', 'cc')} {option}")
    given = [] if by_variable else [option]
    assert run_app(make_app("cc"), ["cc", *given, str(tmp_path / "it.c"), "-o", str(tmp_path / "it")]) == 1
    assert f"leave {option} out" in " ".join(capfd.readouterr().err.split())
    assert not (tmp_path / "it").exists()
