"""The two kinds of kernel: one may allocate, the other is refused when it would."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numba.core.errors import NumbaError
from numpy.typing import NDArray

from qrobot.realtime.compile_once import LOCK_FILE, lock_of
from qrobot.realtime.jit import jit_disabled, kernel, lean_kernel


class Pair(NamedTuple):
    a: NDArray[np.float64]
    b: NDArray[np.float64]


@kernel
def total(pair: Pair) -> float:
    scratch = np.zeros(pair.a.size)
    for i in range(scratch.size):
        scratch[i] = pair.a[i] * pair.b[i]
    return float(scratch.sum())


@lean_kernel
def dot(pair: Pair) -> float:
    result = 0.0
    for i in range(pair.a.size):
        result += pair.a[i] * pair.b[i]
    return result


@lean_kernel
def allocating(n: int) -> float:
    return float(np.zeros(n).sum())


@kernel
def ratio(a: float, b: float) -> float:
    return a / b


def test_both_kinds_take_arrays_out_of_named_tuples() -> None:
    pair = Pair(np.arange(4.0), np.ones(4))
    assert total(pair) == dot(pair) == 6.0


def test_arrays_survive_many_calls_of_a_kernel_that_does_not_count_references() -> None:
    pair = Pair(np.arange(4.0), np.ones(4))
    results = {dot(Pair(pair.a.copy(), pair.b)) for _ in range(1000)}
    assert results == {6.0}
    assert pair.b.tolist() == [1.0] * 4


def test_a_lean_kernel_that_allocates_is_refused_by_the_compiler() -> None:
    if jit_disabled():
        assert allocating(3) == 0.0
        return
    with pytest.raises(NumbaError):
        allocating(3)


def test_a_division_by_zero_is_an_infinity_not_an_exception() -> None:
    with np.errstate(divide="ignore"):
        assert ratio(np.float64(1.0), np.float64(0.0)) == np.inf


MODULE = """
from typing import NamedTuple
import numpy as np
from qrobot.realtime.jit import kernel

class {name}(NamedTuple):
    a: np.ndarray

@kernel
def first(pair):
    return pair.a[0]

print(first({name}(np.ones(2))), sum(first.stats.cache_hits.values()))
"""


@pytest.mark.thorough
def test_a_cache_that_names_a_class_of_the_past_is_stale_and_no_error(tmp_path: Path) -> None:
    file, root = tmp_path / "renamed.py", Path(__file__).parents[3]
    environment = os.environ | {"NUMBA_DISABLE_JIT": "0", "PYTHONPATH": f"{root}{os.pathsep}{tmp_path}"}
    environment["PYTHONDONTWRITEBYTECODE"] = "1"  # Python tells files of one size apart by whole seconds only
    command = [sys.executable, "-c", "import renamed"]
    printed = []
    for name in ("Old", "Old", "New", "New"):
        file.write_text(MODULE.format(name=name))
        done = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, text=True)
        printed.append(done.stdout.strip())
    assert printed == ["1.0 0", "1.0 1", "1.0 0", "1.0 1"]


CROWD = """
from qrobot.realtime.jit import kernel

@kernel
def inner(x):
    return x + 1.0

@kernel
def outer(x):
    return inner(x) * 2.0

kernels = inner, outer
print("ready", flush=True)
input()
outer(1.0), inner(1.0)
print(sum(sum(each.stats.cache_misses.values()) for each in kernels))
"""


@pytest.mark.thorough
def test_of_processes_that_meet_a_new_kernel_together_one_compiles_it_and_the_others_load_it(tmp_path: Path) -> None:
    (tmp_path / "crowd.py").write_text(CROWD)
    root = Path(__file__).parents[3]
    environment = os.environ | {"NUMBA_DISABLE_JIT": "0", "PYTHONPATH": f"{root}{os.pathsep}{tmp_path}"}
    command = [sys.executable, "-c", "import crowd"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    crowd = [subprocess.Popen(command, env=environment, **pipes) for _ in range(3)]  # type: ignore[call-overload]
    for process in crowd:
        assert process.stdout.readline() == "ready\n"
    for process in crowd:
        process.stdin.write("\n")
        process.stdin.flush()
    misses = [int(process.communicate()[0]) for process in crowd]
    assert all(process.returncode == 0 for process in crowd)
    assert sorted(misses) == [0, 0, 2]


def test_a_folder_that_takes_no_lock_file_hinders_nobody(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with lock_of(tmp_path / "file" / "folder", "kernel"):
        pass
    with lock_of(tmp_path, "kernel"), lock_of(tmp_path, "another"):
        assert (tmp_path / LOCK_FILE).exists()
