"""`python -m tests.support.overloads --offline PROGRAM`: kernels of arm and motion that a program compiles too late."""

from __future__ import annotations

import gc
import sys
from collections import Counter

from numba.core.dispatcher import Dispatcher

from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.rccl import connect

OURS = ("qrobot.motion.", "qrobot.model.", "qrobot.fences.")
seen: dict[str, int] = {}


def overloads() -> dict[str, int]:
    """How many signatures of each kernel are compiled or loaded."""
    kernels = [each for each in gc.get_objects() if isinstance(each, Dispatcher)]
    found: Counter[str] = Counter()
    for each in kernels:  # a kernel has two: for calls from Python, and from other kernels
        found[f"{each.py_func.__module__}.{each.py_func.__qualname__}"] += len(each.overloads)
    return {name: number for name, number in found.items() if name.startswith(OURS)}


def main() -> None:
    """Run a program as `qrobot run` does and print what the warm-up has left out."""
    warm_up = connect.compile_all

    def watched(*arguments: object) -> None:
        warm_up(*arguments)  # type: ignore[arg-type]
        seen.update(overloads())

    connect.compile_all = watched
    status = run_app(make_app("run"), ["run", *sys.argv[1:]])
    late = [name for name, number in overloads().items() if number > seen.get(name, 0)]
    print("\n".join(["late:", *sorted(late)]))
    sys.exit(status)


if __name__ == "__main__":
    main()
