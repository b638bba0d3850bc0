"""Who does the work: this process, processes beside it, or the workers of a Dask scheduler on any hosts.

All are a `concurrent.futures.Executor`. Dask's local cluster listens on the loopback interface only.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final, ParamSpec, TypeVar

from qrobot.errors import ConfigError, LinkError

if TYPE_CHECKING:
    from distributed import Client

P = ParamSpec("P")
T = TypeVar("T")

LOOPBACK: Final = "127.0.0.1"
PATIENCE_S: Final = 10.0  # for a scheduler to answer


class InProcess(Executor):
    """Does what it is asked at once, in this process."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """A future that is done."""
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # an executor hands on every error
            future.set_exception(error)
        return future


@dataclass(frozen=True)
class Engine:
    """An executor, and how many tasks it is given before the first is done; None for all there are."""

    executor: Executor
    at_once: int | None
    workers: int


@contextmanager
def engine(workers: int, scheduler: str | None = None) -> Iterator[Engine]:
    """An engine for a campaign; what it has not begun when the block is left is given up.

    Args:
        workers: processes on this machine; 1 is this process itself, and needs no Dask.
        scheduler: address of a running Dask scheduler, as `tcp://host:8786`, in place of processes here.

    Raises:
        ConfigError: Dask is not installed, or `workers` is no number of processes.
        LinkError: no scheduler answers.
    """
    if workers < 1:
        raise ConfigError(f"--workers {workers}: at least 1")
    if scheduler is None and workers == 1:
        yield Engine(InProcess(), 1, 1)
        return
    with _client(workers, scheduler) as client:
        executor = client.get_executor(pure=False)
        try:
            yield Engine(executor, None, len(client.scheduler_info()["workers"]))
        finally:
            executor.shutdown(wait=False)


def _client(workers: int, scheduler: str | None) -> Any:
    """Of a running scheduler, or of one made for the occasion; a context manager."""
    try:
        import distributed
    except ImportError as error:
        raise ConfigError("several workers need Dask: pip install 'qrobot[study]', or --workers 1") from error
    return _local(workers) if scheduler is None else _remote(distributed.Client, scheduler)


@contextmanager
def _local(workers: int) -> Iterator[Client]:
    from distributed import Client, LocalCluster

    with (
        TemporaryDirectory(prefix="qrobot-study-") as scratch,
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,  # a lock-step rig keeps its interpreter busy
            host=LOOPBACK,
            dashboard_address=f"{LOOPBACK}:0",  # left out, it would listen everywhere
            worker_dashboard_address=f"{LOOPBACK}:0",
            memory_limit=0,  # an arm's rows are a few hundred MB for a moment
            silence_logs=logging.ERROR,
            local_directory=scratch,
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client


def _remote(client: Callable[..., Client], scheduler: str) -> Client:
    try:
        return client(scheduler, timeout=PATIENCE_S)
    except (OSError, ValueError) as error:
        raise LinkError(f"no Dask scheduler answers at {scheduler}: start one with `dask scheduler`") from error
