"""How programs in C of Multi-RCCL end that set `terminate`: what they say, and with which status."""

from __future__ import annotations

from pathlib import Path

import pytest

from qrobot.motion import Termination
from tests.support.c_programs import compiled_text, needs_compiler
from tests.system.test_c_manipulators import TWO_ARMS, run

pytestmark = [needs_compiler, pytest.mark.usefixtures("own_cache")]

MOVING = """
#include <stdlib.h>
broken() { terminate = 1; }
main()
{
    POS *p, *q;
    begin();
    p = jposition(left, "P", 40., -45., 180., 0., 45., 0.);
    q = jposition(right, "Q", 40., -45., 180., 0., 45., 0.);
    setime(left, 100., 1000.); setime(right, 100., 4000.);
    move(left, p); move(right, q);
"""


@pytest.mark.parametrize(
    ("end", "left"),
    [
        ("terminate = 1; }", 2),
        ("terminate = 1; exit(0); }", 2),
        ("terminate = 1; exit(3); }", 2),
        ("terminate = 1; rccl_release(left); }", 2),
        ("evalfn(left, broken); move(left, p); evalfn(right, broken); move(right, q); }", 3),
    ],
)
def test_a_program_that_sets_terminate_ends_with_status_1_and_tells_what_was_left(
    end: str, left: int, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    status, traces = run(compiled_text(TWO_ARMS + MOVING + end, tmp_path))
    assert status == 1
    assert capfd.readouterr().err == f"program: the program has set `terminate`: {left} motions were not done\n"
    assert len(traces) == 2
    assert all(trace.requests[-1].code == Termination.STOPPED for trace in traces)
