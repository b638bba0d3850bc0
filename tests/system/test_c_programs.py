"""The programs of Hayward & Paul 1986 in C, beside their twins in Python."""

from __future__ import annotations

import io
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.support.c_programs import EXAMPLES, compiled, keyboard, needs_compiler, way_of_c, way_of_python

pytestmark = needs_compiler

TWINS = {
    "s01_four_corners": ("02_four_corners.py", "starting fourth square\ndone; corners passed 0 4 4 4 times"),
    "s02_grasp": ("03_grasp.py", "hand closed at "),
    "s03_data_base": ("04_data_base.py", "5 locations visited"),
    "s04_stop_on_keyboard": ("05_stop_on_keyboard.py", "hit <return> to stop the arm\nThe arm was in P"),
    "s05_follow_a_surface": ("10_follow_a_surface.py", "over a surface that goes up and down by 10"),
    "s07_stack_blocks": ("11_stack_blocks.py", "two blocks stacked"),
}
ROUNDING = 2e-6  # rad: fields of C programs are single precision, a part in 1e7 of some hundred millimetres or degrees


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.mark.parametrize("name", TWINS)
def test_a_program_of_the_papers_sends_the_setpoints_of_its_twin(name: str, tmp_path: Path, capfd, monkeypatch) -> None:
    twin, said = TWINS[name]
    program = compiled(EXAMPLES / "c" / f"{name}.c", tmp_path)
    with keyboard("\n"):
        in_c = way_of_c(program)
    assert said in capfd.readouterr().out
    monkeypatch.setattr(sys, "stdin", io.StringIO("\n"))
    in_python = way_of_python(twin)
    assert in_c.shape == in_python.shape
    assert np.abs(in_c - in_python).max() < ROUNDING
