"""The running arm and the pendant that tests on the wall clock share, and a cache for programs in C."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from pathlib import Path

import pytest

from tests.support.pendant_process import Pendant, SharedPendant
from tests.support.processes import RunningArm
from tests.support.shared_arm import SharedArm

C_CACHE = Path(__file__).parents[2] / ".pytest_cache" / "libraries of C programs"
PENDANT = pytest.StashKey[SharedPendant]()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark those that share the arm. They come last: it keeps a third of a processor busy, which slows down others."""
    for item in items:
        if "shared_arm" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.shared_arm)
    items.sort(key=lambda item: item.get_closest_marker("shared_arm") is not None)


@pytest.fixture(scope="session")
def shared_arm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SharedArm]:
    shared = SharedArm(tmp_path_factory.mktemp("arm"))
    yield shared
    shared.close()


@pytest.fixture(scope="module")
def parked(shared_arm: SharedArm) -> None:
    """Every file finds the arm as if it had just been started."""
    shared_arm.park()


@pytest.fixture
def arm(shared_arm: SharedArm, parked: None) -> Iterator[RunningArm]:
    """An arm whose processes all run, off and without a fault; so it is again for the next test."""
    yield shared_arm.running()
    shared_arm.put_in_order()


@pytest.fixture(scope="session")
def shared_pendant(shared_arm: SharedArm, request: pytest.FixtureRequest) -> Iterator[SharedPendant]:
    """It ends before that arm does."""
    shared = request.config.stash[PENDANT] = SharedPendant()
    yield shared
    shared.close()


@pytest.fixture
def pendant(
    shared_arm: SharedArm, shared_pendant: SharedPendant, parked: None, tmp_path_factory: pytest.TempPathFactory
) -> Pendant:
    """The pendant of that arm. It runs until a test follows that does not want it."""
    return shared_pendant.of(shared_arm.running(), tmp_path_factory)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> Generator[None, object, object]:
    try:
        return (yield)
    finally:
        if "pendant" not in getattr(nextitem, "fixturenames", ()) and PENDANT in item.config.stash:
            item.config.stash[PENDANT].close()


@pytest.fixture(scope="module")
def own_cache() -> Iterator[None]:
    """A cache of the tests, whose name has blanks, for the library of C programs; the user's stays as it is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(C_CACHE))
        yield


@pytest.fixture
def unpainted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures of runs are files without a picture: to paint them takes a second, and `test_offline` looks at them."""
    monkeypatch.setattr("qrobot.log.plot.save_figure", lambda _figure, path: path.write_bytes(b""))
