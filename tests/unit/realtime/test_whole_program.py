"""Machine code is made of what Python calls, in one piece with all that is called below it."""

from __future__ import annotations

from typing import Any

import llvmlite.binding as llvm
import numba
import numpy as np
import pytest
from numba.core.runtime import _nrt_python as memory

from qrobot.realtime.jit import jit_disabled, kernel, lean_kernel
from qrobot.realtime.whole_program import callees_below

pytestmark = pytest.mark.skipif(jit_disabled(), reason="nothing is compiled")


@lean_kernel
def scaled(x: Any, factor: int) -> Any:
    return factor * x


@lean_kernel
def thrice(x: Any) -> Any:
    return scaled(x, 1) + scaled(x, 2) + scaled(x, 3)


@lean_kernel
def entry(x: Any) -> Any:
    return thrice(x) + 1.0


@lean_kernel
def another_entry(x: Any) -> Any:
    return thrice(x) - 1.0


@kernel
def chosen(pair: Any, which: int) -> Any:
    return pair[which]


@kernel
def first_and_last(pair: Any) -> Any:
    return chosen(pair, 0) * chosen(pair, 1)[1]


@kernel
def root(x: float) -> float:
    if x < 0.0:
        raise ValueError("no root")
    return x**0.5


@kernel
def sum_of_roots(values: Any) -> float:
    total = np.zeros(1)
    for value in values:
        total[0] += root(value)
    return float(total[0])


def compile_anew(*entries: Any) -> None:
    """As from an empty cache, which would give entries alone."""
    for each in entries:
        assert each(2.0) > 0.0
        each.recompile()


def callee(half: Any) -> Any:
    """What other kernels call of a kernel."""
    return half.callee()


def test_what_only_kernels_call_has_no_machine_code_of_its_own() -> None:
    compile_anew(entry, another_entry)
    assert entry(2.0) == 13.0
    assert another_entry(2.0) == 11.0
    assert [thrice.signatures, len(callee(thrice).signatures)] == [[], 1]  # type: ignore[attr-defined]


def test_a_kernel_can_be_called_both_ways() -> None:
    assert entry(2.0) == 13.0
    assert scaled(2.0, 3) == 6.0
    assert thrice(np.float64(2.0)) == 12.0


def test_a_callee_is_compiled_once_for_all_literal_arguments() -> None:
    compile_anew(entry)
    doubles = [each for each in callee(scaled).signatures if each[0] == numba.float64]
    assert doubles == [(numba.float64, numba.int64)]


def test_a_callee_that_needs_to_know_a_literal_is_told_it() -> None:
    assert first_and_last((2.0, np.array([3.0, 5.0]))) == 10.0


def test_entries_share_no_names_in_which_they_could_meet_each_others_code() -> None:
    """Two entries of different types have functions of one name, which the loader would take for one function."""

    @lean_kernel
    def fresh(x: Any) -> Any:  # not out of the cache, where only machine code is left
        return thrice(x)

    assert fresh(1) == 6
    (result,) = fresh.overloads.values()  # type: ignore[attr-defined]
    linkages = {each.linkage for each in result.library._final_module.functions if not each.is_declaration}
    assert linkages <= {llvm.Linkage.external, llvm.Linkage.internal}


def test_what_is_below_a_kernel_is_known_before_it_is_compiled() -> None:
    assert callees_below(entry.py_func) == {callee(thrice), callee(scaled)}  # type: ignore[attr-defined]


def test_a_function_that_numba_compiles_alone_may_call_kernels() -> None:
    assert numba.njit(lambda x: entry(x) + thrice(x))(2.0) == 25.0


def test_an_exception_comes_through_from_a_kernel_below() -> None:
    assert sum_of_roots(np.array([4.0, 9.0])) == 5.0
    with pytest.raises(ValueError, match="no root"):
        sum_of_roots(np.array([4.0, -9.0]))


def test_arrays_made_below_are_freed() -> None:
    memory.memsys_enable_stats()
    try:
        sum_of_roots(np.ones(3))
        before = memory.memsys_get_stats_alloc(), memory.memsys_get_stats_free()
        for _ in range(100):
            sum_of_roots(np.ones(3))
        after = memory.memsys_get_stats_alloc(), memory.memsys_get_stats_free()
    finally:
        memory.memsys_disable_stats()
    made, freed = (now - then for now, then in zip(after, before, strict=True))
    assert made == freed >= 100
