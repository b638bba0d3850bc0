"""Shared test profile: hypothesis measures no time (compiling is not slow), derandomised for bit-identical CI.

Tests that are not marked `realtime` are refused every clock; those that are have reruns, named at the end of a run.
"""

import gc
import os
import signal
import sys
import tempfile
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers

from tests.support import clocks
from tests.support.patience import PATIENCE_S
from tests.support.thorough import examples, mark_thorough, run_a_part
from tests.support.turns import turn

# Before anything of ours is imported, which may keep a clock under a name of its own.
clocks.install()

# Generated kernels stay with the other caches of the tests, not in the home directory; subprocesses inherit it.
os.environ.setdefault("QROBOT_CACHE", str(Path(__file__).parents[1] / ".pytest_cache" / "qrobot"))

# Matrices of a robot are small: BLAS threads that wait for each other beside other workers only cost time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# A shell ignores Ctrl-C for what it runs in the background, and every process started from here would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Hypothesis would try constants of whichever modules of ours are loaded, which depends on the tests that ran before.
providers.is_local_module_file = lambda _path: False

# Of a failed test on the wall clock: a shared machine may stop as a whole for longer than any bound allows.
RERUNS = int(os.environ.get("QROBOT_RERUNS", "2"))


def pytest_configure(config: pytest.Config) -> None:
    run_a_part("not thorough" in config.option.markexpr)
    settings.register_profile(
        "qrobot",
        max_examples=examples(50),  # the same every time: more of them find what they find once
        deadline=None,
        derandomize=True,
        print_blob=True,
        suppress_health_check=[HealthCheck.too_slow],
    )
    settings.load_profile("qrobot")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Where tests on the wall clock alone are run, files without any are not imported."""
    if not config.option.markexpr.startswith("realtime") or not collection_path.match("test_*.py"):
        return None
    return True if b"mark.realtime" not in collection_path.read_bytes() else None


@pytest.hookimpl(tryfirst=True)  # before the tests that nobody asked for are left out
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    mark_thorough(items)
    for item in items:
        if RERUNS and item.get_closest_marker("realtime") is not None:
            item.add_marker(pytest.mark.flaky(reruns=RERUNS, reruns_delay=1))


def pytest_collection_finish() -> None:
    _look_for_garbage()


def _look_for_garbage() -> None:
    """Look now, and not among what is left again: tests, libraries and compiled kernels stay to the end."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    if item.get_closest_marker("realtime") is None:
        return (yield)
    with turn(alone=item.get_closest_marker("starves_others") is not None):
        _look_for_garbage()  # a look among all that has come since takes longer than a program's setpoints may
        return (yield)


def _without_clocks(item: pytest.Item) -> Generator[None, object, object]:
    if clocks.may_read_clocks(item.nodeid, item.get_closest_marker("realtime") is not None):
        return (yield)
    with clocks.virtual_time_only():
        return (yield)


# Of a test, and of the fixtures it is the first one to ask for.
pytest_runtest_setup = pytest.hookimpl(wrapper=True)(_without_clocks)
pytest_runtest_call = pytest.hookimpl(wrapper=True)(_without_clocks)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown() -> Generator[None, object, object]:
    """What a command of one test tells its program of the bridge is not for the programs of the next."""
    result = yield
    os.environ.pop("QROBOT_BRIDGE", None)
    return result


def pytest_sessionfinish() -> None:
    """Bridges that tests have killed leave their tokens; the next bridge would remove them, and there is none."""
    from qrobot.realtime.bridge_token import remove_dead_tokens  # not before the clocks are checked

    remove_dead_tokens()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Name every test that was run again, and what it had failed by: a quiet machine needs none."""
    again = terminalreporter.stats.get("rerun", [])
    if again:
        terminalreporter.section(f"{len(again)} reruns")
    for report in again:
        terminalreporter.line(f"RERUN {report.nodeid} - {_reason(report)}")


def _reason(report: pytest.TestReport) -> str:
    """The first line of what a test failed by."""
    crash = getattr(report.longrepr, "reprcrash", None)
    return str(crash.message if crash is not None else report.longrepr).partition("\n")[0]


@pytest.fixture(scope="module", autouse=True)
def _no_arm_stays_held() -> Iterator[None]:
    """The end of a program lets go of all arms of its process: also of those that tests before it had left held."""
    yield
    if (loaded := sys.modules.get("qrobot.rccl.arm_session")) is not None:
        left = [hold._name for hold in loaded.ArmSession._holds]
        loaded.ArmSession.end_all(well=False)
        assert not left, f"tests of this module still hold {left}"


@pytest.fixture
def arcl_alone() -> Iterator[None]:
    """Nothing of an earlier program of ARCL is there, and nothing is left."""
    from tests.support.arcl import forget_programs

    forget_programs()
    yield
    forget_programs()


@pytest.fixture
def patient_links(monkeypatch: pytest.MonkeyPatch) -> None:
    """The far end of a socket is a thread of ours, which may stall; who tests silence is less patient."""
    from qrobot.rci import tcp

    for name in ("ANSWER_TIMEOUT_S", "STEP_TIMEOUT_S", "LINGER_S"):
        monkeypatch.setattr(tcp, name, PATIENCE_S)


@pytest.fixture
def runtime_folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A runtime folder of the test's own, in memory: no arm runs there but its own."""
    from qrobot.realtime.runtime_folder import MEMORY_FOLDER

    with tempfile.TemporaryDirectory(dir=MEMORY_FOLDER) as folder:
        monkeypatch.setenv("QROBOT_RUNTIME_DIR", folder)
        yield Path(folder)
