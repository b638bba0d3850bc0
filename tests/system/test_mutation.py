"""No mistake in the safety gates goes unnoticed by their unit tests, but for those that make no difference."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.mutation.mutants import mutants

FEWEST = 250  # a run that finds less to mutate has lost a module


@pytest.mark.thorough
def test_every_mutant_of_the_gates_is_noticed_or_explained() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.mutation"], cwd=Path(__file__).parents[2], check=False, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    counted = re.search(r"^(\d+) mutants", done.stdout, re.MULTILINE)
    assert counted is not None
    assert int(counted[1]) >= FEWEST


def test_a_check_is_turned_round_shifted_and_left_out() -> None:
    changes = [str(mutant) for mutant in mutants("def check(x: int) -> int:\n    if not x <= 2:\n        return 1\n")]
    assert changes == [
        "if not x <= 2:  ->  if False:",
        "if not x <= 2:  ->  if True:",
        "not x <= 2  ->  x <= 2",
        "x <= 2  ->  x < 2",
        "x <= 2  ->  x > 2",
        "2  ->  3",
        "1  ->  2",
    ]
