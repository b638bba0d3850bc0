"""No sample waits for the compiler: what a program calls is compiled before the arm waits for it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from qrobot.realtime.jit import jit_disabled
from tests.support.thorough import wide

ROOT = Path(__file__).parents[2]


@pytest.mark.skipif(jit_disabled(), reason="nothing is compiled")
@pytest.mark.parametrize(
    "words",
    [
        *wide("--offline examples/06_conveyor.py"),
        "--lockstep examples/09_peg_in_hole.py",  # it gives way
        *wide("--offline --deployment examples/19_fences.toml examples/19_fences.py"),
    ],
)
def test_a_program_calls_no_kernel_of_arm_and_motion_that_the_warm_up_has_left_out(words: str, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "tests.support.overloads", *words.split(), "--output", tmp_path]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.endswith("late:\n\n") or done.stdout.endswith("late:\n"), done.stdout
