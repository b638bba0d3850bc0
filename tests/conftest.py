"""Shared test profile: hypothesis measures no time (compiling is not slow), derandomised for bit-identical CI."""

import os
import signal
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers

# Generated kernels stay with the other caches of the tests, not in the home directory; subprocesses inherit it.
os.environ.setdefault("QROBOT_CACHE", str(Path(__file__).parents[1] / ".pytest_cache" / "qrobot"))

# Matrices of a robot are small: BLAS threads that wait for each other beside other workers only cost time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# A shell ignores Ctrl-C for what it runs in the background, and every process started from here would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Hypothesis would try constants of whichever modules of ours are loaded, which depends on the tests that ran before.
providers.is_local_module_file = lambda _path: False

# Fifty examples: they are the same every time, so that more of them find what they find once.
settings.register_profile(
    "qrobot",
    max_examples=50,
    deadline=None,
    derandomize=True,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("qrobot")

WALL_CLOCK_RERUNS = 2


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Repeat a failed wall-clock test: a shared machine may stop as a whole for longer than any bound allows."""
    for item in items:
        if item.get_closest_marker("realtime") is not None:
            item.add_marker(pytest.mark.flaky(reruns=WALL_CLOCK_RERUNS, reruns_delay=1))
