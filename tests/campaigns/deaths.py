"""A servo that dies after any of its stores: `tests.support.kill_point_checks` over every way to the board."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def campaign() -> int:
    """Run the checks in plain Python; 0 when all of them pass."""
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests/support/kill_point_checks.py"]
    plain = {"NUMBA_DISABLE_JIT": "1", "QROBOT_ALL_WAYS": "1"}
    return subprocess.run(command, env=os.environ | plain, cwd=ROOT, check=False).returncode
