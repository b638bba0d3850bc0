"""A program in C that moves on and on, and what is measured of one: nothing is judged by the clock."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.c_moves import LOOKS, MEMORY_BOUND, Held, Moves, c_moves
from benchmarks.c_programs import CALLS, bare_exchange_us, call_times_us, made
from benchmarks.move_requests import arcl_us, c_us, rccl_us, val_us
from tests.support.c_programs import needs_compiler

pytestmark = pytest.mark.usefixtures("own_cache")

HELD = Held(
    samples=100, engine_bytes=1 << 27, program_bytes=1 << 20, blocks=10**6, descriptors=(9, 5), mappings=(99, 9)
)


@needs_compiler
def test_program_and_engine_are_looked_at_again_and_again_while_a_program_moves() -> None:
    result = c_moves(40)
    assert result.status == 0
    assert len(result.held) >= LOOKS - 2
    assert result.held[-1].samples > 200
    assert result.held[-1].program_bytes > 100_000
    assert all(held.descriptors[1] >= 3 for held in result.held)


@pytest.mark.thorough
@needs_compiler
@pytest.mark.parametrize("moves", [800, 2000])
def test_neither_program_nor_engine_holds_more_after_all_moves_than_after_half_of_them(moves: int) -> None:
    assert c_moves(moves).failures == []


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"engine_bytes": HELD.engine_bytes + MEMORY_BOUND + 1}, "memory of the engine"),
        ({"program_bytes": HELD.program_bytes + MEMORY_BOUND + 1}, "memory of the program"),
        ({"descriptors": (9, 6)}, "descriptors"),
        ({"mappings": (99, 10)}, "mappings of the program"),
    ],
)
def test_what_grows_in_the_second_half_is_named(change: dict[str, object], named: str) -> None:
    flat = Moves(100_000, 0, [HELD] * 20)
    assert flat.failures == []
    (failure,) = replace(flat, held=[*flat.held[:-1], replace(HELD, **change)]).failures  # type: ignore[arg-type]
    assert failure.startswith(f"{named} grew by ")
    grown_before = [HELD, *[replace(HELD, **change)] * 19]  # type: ignore[arg-type]
    assert replace(flat, held=grown_before).failures == []


@pytest.mark.parametrize("moves", [400, 1000, 100_000])
def test_an_object_that_each_move_leaves_is_named_and_a_cache_that_fills_once_is_not(moves: int) -> None:
    leaking = [replace(HELD, blocks=HELD.blocks + moves * look // LOOKS) for look in range(LOOKS)]
    assert Moves(moves, 0, leaking).failures == [f"blocks of the engine grew by {3 * moves // LOOKS}"]
    filled = [replace(HELD, blocks=HELD.blocks + 100_000 * (look > 5)) for look in range(LOOKS)]
    assert Moves(moves, 0, filled).failures == []


def test_a_program_that_failed_has_shown_nothing() -> None:
    assert Moves(10, 1, [HELD] * 20).failures == ["the program ended with status 1 after 20 looks"]
    assert Moves(10, 0, []).failures != []


@needs_compiler
def test_move_requests_of_both_libraries_are_timed_in_c_and_in_python(tmp_path: Path) -> None:
    times = [
        arcl_us(1),
        rccl_us(1),
        *val_us(1),
        *(c_us(made(f"{name}_requests", tmp_path), 1) for name in ("arcl", "rccl")),
    ]
    assert all(0.0 < us < 1e6 for us in times)


@needs_compiler
def test_each_function_of_a_sample_is_timed(tmp_path: Path) -> None:
    times = call_times_us(made("callbacks", tmp_path), 4)
    assert times.shape[0] >= 4
    assert times.shape[1] == CALLS
    assert (times > 0.0).all()
    assert bare_exchange_us(2) > 0.0
