"""A code that a program assigns while the engine takes the one before."""

from __future__ import annotations

import threading
from typing import Any, Final

import numpy as np
import pytest

from qrobot.c_transport.assigned_code import NONE, AssignedCode
from qrobot.multi_rccl.c.shared_manip import INT, STATE
from qrobot.realtime.atomics import load_acquire, store_release
from qrobot.realtime.jit import jit_disabled, kernel

ROUNDS: Final = 500
WIDEST: Final = 400  # between two assignments: some microseconds


@kernel
def assign_two(words: Any, rounds: int) -> None:
    """Be a program: assign a code and soon another one, and wait until there is none."""
    for k in range(1, rounds + 1):
        store_release(words, 0, 2 * k - 1)
        for _ in range(7 * k % WIDEST):
            load_acquire(words, 0)
        store_release(words, 0, 2 * k)
        while load_acquire(words, 0) != NONE:
            pass


@pytest.mark.skipif(jit_disabled(), reason="a plain access is right for one thread")
def test_the_code_that_was_assigned_last_is_taken_whenever_that_was() -> None:
    words = np.zeros(1, np.int64)
    assign_two(words, 0)  # compiled
    code = AssignedCode(words.view(np.int32)[:1])
    program = threading.Thread(target=assign_two, args=(words, ROUNDS))
    program.start()
    taken: list[int] = []
    while program.is_alive():
        if (one := code.take()) != NONE:
            taken.append(one)
    assert set(range(2, 2 * ROUNDS + 1, 2)) <= set(taken)
    assert len(taken) == len(set(taken))


@pytest.mark.parametrize("given", [7, -3, (1 << 31) - 1, -(1 << 31)])
def test_a_code_is_taken_once_with_its_sign_and_nothing_beside_it(given: int) -> None:
    words = np.array([1, given, 2], np.int32)
    code = AssignedCode(words[1:2])
    assert (code.take(), code.take()) == (given, NONE)
    assert words.tolist() == [1, NONE, 2]


def test_the_code_of_a_manipulator_is_the_last_of_its_integers() -> None:
    assert STATE.fields is not None
    assert STATE.fields["nextmove"][1] == STATE.itemsize - INT
