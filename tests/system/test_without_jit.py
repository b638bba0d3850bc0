"""The kernels as plain Python: the same tests, the oracle instead of the compiled code."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.thorough import wide_rows

ROOT = Path(__file__).parents[2]
MODULES = (
    "sim_board/test_board",
    "hwif/test_board_memory",
    "codegen/test_codegen_operations",
    "realtime/test_seqlock",
    "realtime/test_structure",
    "realtime/test_clock",
    "sim_board/test_drive",
    "realtime/test_pointer",
)


@pytest.mark.parametrize(
    ("modules", "tests"),
    [
        (("hwif/test_board_memory", "realtime/test_seqlock"), "not thorough"),
        *wide_rows((MODULES, "")),
    ],
    ids=["some", "all"],
)
def test_the_tests_of_the_kernels_pass_with_the_jit_off(modules: tuple[str, ...], tests: str) -> None:
    files = [f"tests/unit/{name}.py" for name in modules]
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", tests, *files]
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(command, env=environment, cwd=ROOT, check=False, stdout=subprocess.PIPE, text=True)
    assert done.returncode == 0, done.stdout
    assert "passed" in done.stdout
    assert "skipped" not in done.stdout
