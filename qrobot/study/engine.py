"""Workers of a study: this process, processes beside it, or those of a Dask scheduler on any hosts.

All are a `concurrent.futures.Executor`. Nothing listens on this machine; a Dask scheduler is somebody else's.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import active_children, get_context, parent_process
from typing import TYPE_CHECKING, Final, ParamSpec, TypeVar

from qrobot.errors import ConfigError, LinkError
from qrobot.extras import missing_library

if TYPE_CHECKING:
    from distributed import Client

P = ParamSpec("P")
T = TypeVar("T")

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
        workers: processes on this machine; 1 is this process itself.
        scheduler: address of a running Dask scheduler, as `tcp://host:8786`, in place of processes here.

    Raises:
        ConfigError: a scheduler is given and Dask is not installed, or `workers` is no number of processes.
        LinkError: no scheduler answers.
    """
    if workers < 1:
        raise ConfigError(f"--workers {workers}: at least 1")
    if scheduler is None and workers == 1:
        yield Engine(InProcess(), 1, 1)
        return
    with _processes(workers) if scheduler is None else _cluster(scheduler) as made:
        yield made


@contextmanager
def _processes(workers: int) -> Iterator[Engine]:
    """Processes of our own, reached by pipes: a port would do what any account of this machine asks for."""
    executor = ProcessPoolExecutor(workers, get_context("spawn"), initializer=_leave_to_parent)
    before = set(active_children())
    try:
        yield Engine(executor, None, workers)
        executor.shutdown(cancel_futures=True)
    except BaseException as error:
        executor.shutdown(wait=False, cancel_futures=True)
        for child in set(active_children()) - before:
            child.terminate()
        if isinstance(error, BrokenProcessPool):
            raise LinkError("a worker was killed, perhaps for want of memory: the same command goes on") from error
        raise


def _leave_to_parent() -> None:
    """Worker: Ctrl-C is the parent's affair, and without a parent, whatever has ended it, there is nothing to do."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    if (parent := parent_process()) is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _cluster(scheduler: str) -> Iterator[Engine]:
    try:
        import distributed
    except ImportError as error:
        raise ConfigError(f"{missing_library('distributed')}, or leave --scheduler out") from error
    with _remote(distributed.Client, scheduler) as client:
        executor = client.get_executor(pure=False)
        try:
            yield Engine(executor, None, len(client.scheduler_info()["workers"]))
        finally:
            executor.shutdown(wait=False)


def _remote(client: Callable[..., Client], scheduler: str) -> Client:
    try:
        return client(scheduler, timeout=PATIENCE_S)
    except (OSError, ValueError) as error:
        raise LinkError(f"no Dask scheduler answers at {scheduler}: start one with `dask scheduler`") from error
