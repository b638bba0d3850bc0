"""The programs of Hayward & Paul 1986 in C under valgrind, as made by every compiler that is there.

S-06 moves in contact, hence not off line: see test_c_crank.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from qrobot.rccl.c.program import run_executable
from tests.support.c_programs import (
    EXAMPLES,
    FOUND,
    compiled,
    compiled_text,
    keyboard,
    needs_compiler,
    needs_valgrind,
    under_valgrind,
    way_of_c,
)

SAID = {
    "s01_four_corners": "done; corners passed 0 4 4 4 times",
    "s02_grasp": "hand closed at ",
    "s03_data_base": "5 locations visited",
    "s04_stop_on_keyboard": "LOC is now",
    "s05_follow_a_surface": "over a surface that goes up and down by 10",
    "s07_stack_blocks": "two blocks stacked",
}
# By gcc, whose -O0 has the sanitizers in test_c_programs, and by clang, at one level or the other.
LEVELS = zip(SAID, ("-O0", "-O2") * len(SAID), strict=False)
MADE = [made for name, level in LEVELS for made in ((name, "gcc", "-O2"), (name, "clang", level))]

pytestmark = [needs_compiler, needs_valgrind, pytest.mark.usefixtures("own_cache")]


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("name", "compiler", "level"), MADE)
def test_valgrind_finds_nothing_whoever_has_compiled_a_program(
    name: str, compiler: str, level: str, tmp_path: Path, monkeypatch, capfd
) -> None:
    if not shutil.which(compiler):
        pytest.skip(f"no {compiler}: apt install {compiler}")
    monkeypatch.setenv("CC", compiler)
    program = compiled(EXAMPLES / "c" / f"{name}.c", tmp_path, level, "-gdwarf-4")
    with keyboard("\n"):
        way_of_c(under_valgrind(program))
    assert SAID[name] in capfd.readouterr().out


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("mistake", "found"),
    [
        ("int *p = malloc(4); if (*p) printf(\"set\\n\"); free(p);", "uninitialised"),
        ("t->p.z = ((float *) malloc(4))[1];", "Invalid read"),
        ("malloc(40);", "definitely lost"),
    ],
)  # fmt: skip
def test_valgrind_would_tell(mistake: str, found: str, tmp_path: Path, capfd) -> None:
    text = f'#include <stdlib.h>\nmain() {{ TRSF_PTR t = newtrans("T", varb); {{ {mistake} }} t = NULL; return 0; }}'
    program = compiled_text(text, tmp_path, "-g")
    assert run_executable(under_valgrind(program)) == FOUND
    assert found in capfd.readouterr().err
