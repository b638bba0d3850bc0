"""Rows 2 and 2b: the paper's Table 2 law and the six-joint law, compiled by Numba and by a C compiler, and in NumPy."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from benchmarks import sixlaw, twolink, twolink_numpy
from benchmarks.ctwin import pointer, twin
from benchmarks.rows import Goal, Row, against, row
from benchmarks.timing import Effort, interleaved, seconds

ROOT: Final = Path(__file__).parents[1]
ITERATIONS: Final = 1_000_000
NUMPY_ITERATIONS: Final = 5_000
PYTHON_ITERATIONS: Final = 50_000
CALLS: Final = 1_000_000
PENTIUM_PRO_S, C30_S = 17.0, 548.0  # per 10^6 iterations: QRobot paper, Table 2
NEAR_C: Final = Goal(1.1, "ratio")


def rows(effort: Effort) -> Iterator[Row]:
    """The rows."""
    yield from table_2(effort)
    for smooth in (True, False):
        yield six_joints(effort, smooth)


def table_2(effort: Effort) -> Iterator[Row]:
    """Seconds per 10^6 iterations of the paper's law."""
    n, few = effort.times(ITERATIONS), effort.times(NUMPY_ITERATIONS)
    twolink.iterations(twolink.fresh(), 1)
    contenders: dict[str, Any] = {"numba": lambda: twolink.iterations(twolink.fresh(), n)}
    if (c := c_iterations()) is not None:
        contenders["C"] = lambda: c(n)
    times = {name: duration / n * 1e6 for name, duration in interleaved(contenders, effort.rounds).items()}
    name, unit = "Table 2 law, 10^6 iterations", "s"
    if "C" in times:
        yield against(f"{name}, Numba", times["numba"], unit, "C -O3", times["C"], NEAR_C)
    yield against(f"{name}, Numba", times["numba"], unit, "Pentium Pro 200 (paper)", PENTIUM_PRO_S)
    yield against(f"{name}, Numba", times["numba"], unit, "TMS320C30 (paper)", C30_S)
    slow = seconds(lambda: twolink_numpy.iterations(few)) / few * 1e6
    yield against(f"{name}, NumPy", slow, unit, "Numba", times["numba"])
    yield against(
        f"{name}, plain Python", plain_python_s(effort.times(PYTHON_ITERATIONS)), unit, "Numba", times["numba"]
    )


def plain_python_s(n: int) -> float:
    """Seconds per 10^6 iterations of the same functions with the JIT off."""
    measure = f"print(seconds(lambda: twolink.iterations(twolink.fresh(), {n})))"
    program = f"from benchmarks import twolink; from benchmarks.timing import seconds; {measure}"
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run([sys.executable, "-c", program], env=environment, cwd=ROOT, check=True, capture_output=True)
    return float(done.stdout) / n * 1e6


def c_iterations() -> Any:
    """The C twin of `twolink.iterations` from a fresh state; None without a compiler."""
    library = twin("twolink")
    if library is None:
        return None
    library.iterations.restype = ctypes.c_double

    def run(n: int) -> float:
        state = twolink.fresh()
        return float(library.iterations(pointer(state), ctypes.c_long(n)))

    return run


def six_joints(effort: Effort, smooth: bool) -> Row:
    """Nanoseconds per call of the six-joint law."""
    n = effort.times(CALLS)
    sixlaw.law_calls(*sixlaw.arguments(), smooth, 1)
    contenders: dict[str, Any] = {"numba": lambda: sixlaw.law_calls(*sixlaw.arguments(), smooth, n)}
    if (c := c_law_calls(smooth)) is not None:
        contenders["C"] = lambda: c(n)
    times = {key: duration / n * 1e9 for key, duration in interleaved(contenders, effort.rounds).items()}
    name = f"six-joint law, friction by {'tanh' if smooth else 'a clipped line'}, Numba"
    if "C" not in times:
        return row(name, times["numba"], "ns")
    return against(name, times["numba"], "ns", "C -O3", times["C"], Goal(1.3, "ratio"))


def c_law_calls(smooth: bool) -> Any:
    """The C twin of `sixlaw.law_calls`; None without a compiler."""
    library = twin("sixlaw")
    if library is None:
        return None
    library.law_calls.restype = ctypes.c_double

    def run(n: int) -> float:
        arrays = sixlaw.arguments()
        return float(library.law_calls(*map(pointer, arrays), ctypes.c_bool(smooth), ctypes.c_long(n)))

    return run
