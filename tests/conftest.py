"""Shared test profile: no hypothesis deadline (compiling is not a slow example), derandomised for bit-identical CI."""

import os
from pathlib import Path

from hypothesis import settings

# Generated kernels stay with the other caches of the tests, not in the home directory; subprocesses inherit it.
os.environ.setdefault("QROBOT_CACHE", str(Path(__file__).parents[1] / ".pytest_cache" / "qrobot"))

settings.register_profile("qrobot", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("qrobot")
