"""`python -m tests.mutation`: is there a mistake in the safety gates that their tests would not notice?

The modules are changed in one place after the other (`mutants`), and their unit tests run on each mutant until one
fails. A mutant that none fails on is a hole in the tests, or makes no difference: then `explained.py` says why. The JIT
is off, and each mutant lives in a forked process in which the tests have been collected already: ten in a second.

Ends with 0 when every survivor is explained and every explanation still has its survivor.
"""

from __future__ import annotations

import gc
import importlib
import os
import signal
import sys
import time
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, Final

import pytest
from _pytest.runner import runtestprotocol

from tests.mutation.explained import EXPLAINED
from tests.mutation.mutants import Mutant, mutants

CHECKS: Final = ("limit_checks", "motor_fault_diagnosis", "timing_checks", "dead_encoder")
GATES: Final = (*CHECKS, "stop_categories")
TESTED_WITH: Final = {"stop_categories": "limit_checks"}
PATIENCE_S: Final = 30  # a mutant that never ends is noticed
SURVIVED = 255  # of a process that ends; else the place of the test that has noticed, or a signal


def gate_modules() -> dict[str, ModuleType]:
    """The modules to be mutated, by name."""
    rooms = {gate: "servo.checks" if gate in CHECKS else "servo" for gate in GATES}
    return {gate: importlib.import_module(f"qrobot.{room}.{gate}") for gate, room in rooms.items()}


def become(module: ModuleType, mutant: Mutant) -> None:
    """Let the functions and constants of `module` be the mutant's, wherever they were imported to."""
    namespace: dict[str, Any] = {"__name__": module.__name__}
    code: CodeType = compile(mutant.tree, str(module.__file__), "exec")
    exec(code, namespace)
    for name, value in namespace.items():
        mine = vars(module).get(name)
        if isinstance(mine, FunctionType) and mine.__module__ == module.__name__:
            mine.__code__, mine.__defaults__ = value.__code__, value.__defaults__
        elif name.strip("_").isupper():
            setattr(module, name, value)


class MutationRun:
    """A pytest plug-in that runs the tests collected once for every mutant."""

    def __init__(self) -> None:
        self.survivors: list[tuple[str, Mutant]] = []
        self.count = 0

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """In place of pytest's own. Ends the session when they fail on the modules as they are."""
        gc.freeze()  # pages that no collection touches stay shared with the children
        for gate, module in gate_modules().items():
            own = [item for item in session.items if item.path.stem == f"test_{TESTED_WITH.get(gate, gate)}"]
            if session.testsfailed or noticed_by(own, None, None) is not None:
                raise session.Failed("the tests fail without any mutation: run them first")
            for mutant in mutants(Path(str(module.__file__)).read_text()):
                self.count += 1
                place = noticed_by(own, module, mutant)
                if place is None:
                    self.survivors.append((gate, mutant))
                else:
                    own.insert(0, own.pop(place))  # is likely to notice the next mutant, in the same line, as well
        return True


def noticed_by(items: list[pytest.Item], module: ModuleType | None, mutant: Mutant | None) -> int | None:
    """Place of the first test that fails on the mutant, in a process of its own; None when none does.

    A crash and an endless loop are noticed too, by nobody in particular: 0.
    """
    assert len(items) < SURVIVED
    child = os.fork()
    if child == 0:
        signal.alarm(PATIENCE_S)
        gc.disable()
        os._exit(verdict(items, module, mutant))  # never back into the parent's tests
    _, status = os.waitpid(child, 0)
    if not os.WIFEXITED(status):
        return 0
    return None if os.WEXITSTATUS(status) == SURVIVED else os.WEXITSTATUS(status)


def verdict(items: list[pytest.Item], module: ModuleType | None, mutant: Mutant | None) -> int:
    """Run the tests on the mutant, or without one on what is there, until one fails: its place, or SURVIVED."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    try:
        if module is not None and mutant is not None:
            become(module, mutant)
    except Exception:  # it does not even load
        return 0
    for place, (item, following) in enumerate(zip(items, [*items[1:], None], strict=True)):
        if any(report.failed for report in runtestprotocol(item, nextitem=following, log=False)):
            return place
    return SURVIVED


def tell(run: MutationRun, seconds: float) -> int:
    """Print the survivors without an explanation and the explanations without a survivor; the exit status."""
    found = {(gate, str(mutant)) for gate, mutant in run.survivors}
    holes = [
        f"not noticed: {gate}.py:{mutant.line}: {mutant}"
        for gate, mutant in run.survivors
        if (gate, str(mutant)) not in EXPLAINED
    ]
    stale = [f"explained, but noticed or gone: {gate}: {change}" for gate, change in sorted(EXPLAINED.keys() - found)]
    explained = len(run.survivors) - len(holes)
    print(f"{run.count} mutants: {run.count - len(run.survivors)} noticed, {explained} explained, {seconds:.0f} s")
    for line in (*holes, *stale):
        print(line)
    return 1 if holes or stale or not run.count else 0


def main() -> int:
    """The whole run."""
    if os.environ.get("NUMBA_DISABLE_JIT") != "1":
        os.execve(sys.executable, [sys.executable, "-m", "tests.mutation"], os.environ | {"NUMBA_DISABLE_JIT": "1"})
    run, began = MutationRun(), time.monotonic()
    tests = [f"tests/unit/servo/test_{gate}.py" for gate in CHECKS]
    status = pytest.main(
        ["-q", "-s", "--tb=native", "-p", "no:cacheprovider", "-p", "no:logging", "--timeout=0", *tests], plugins=[run]
    )
    if status not in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED):
        return int(status)
    return tell(run, time.monotonic() - began)


if __name__ == "__main__":
    sys.exit(main())
