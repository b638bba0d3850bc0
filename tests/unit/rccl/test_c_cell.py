"""A call through shared memory, seen from the engine: what it writes, and what it makes of the program's words."""

from __future__ import annotations

import re

import numpy as np
import pytest

from qrobot.c_transport import callback_slot
from qrobot.c_transport.callback_slot import SLOT_WORDS, CallbackSlot
from qrobot.c_transport.message import Op
from qrobot.cli import toolchain

WORDS = "called", "op", "ref", "processor", "done", "asking", "looking", "waiting"
PLACE = 4096


@pytest.fixture
def words(monkeypatch) -> np.ndarray:
    monkeypatch.setattr(callback_slot, "jit_disabled", lambda: False)  # alone, the kernel is right as plain Python too
    return np.zeros(SLOT_WORDS, np.int64)


def put(words: np.ndarray, **values: int) -> None:
    for name, value in values.items():
        words[WORDS.index(name)] = value


def seen(words: np.ndarray, *names: str) -> list[int]:
    return [int(words[WORDS.index(name)]) for name in names]


def test_engine_and_library_have_the_same_words() -> None:
    shim = (toolchain.SOURCES / "channel.h").read_text()
    fields = re.search(r"struct shim_cell \{(.*?)\};", shim, re.DOTALL)[1]
    assert tuple(re.findall(r"\b(\w+)[,;]", re.sub(r"/\*.*?\*/", "", fields))) == WORDS
    assert len(WORDS) == SLOT_WORDS


def test_a_call_that_nobody_looks_for_stands_in_the_cell_and_needs_a_message(words) -> None:
    called = CallbackSlot(words)
    assert called.call(Op.CALL_FUNCTION, PLACE) == callback_slot.UNSEEN
    assert seen(words, "called", "op", "ref") == [called.number, Op.CALL_FUNCTION, PLACE] == [1, 105, PLACE]


def test_a_call_is_done_when_the_program_has_written_its_number(words) -> None:
    put(words, looking=1, done=1)
    called = CallbackSlot(words)
    assert called.call(Op.CALL_FUNCTION, PLACE) == callback_slot.DONE
    assert called.call(Op.CALL_FUNCTION, PLACE) == callback_slot.UNSEEN  # the second one is not done


def test_a_function_that_asks_is_listened_to_without_a_message(words) -> None:
    put(words, looking=1, asking=1)
    assert CallbackSlot(words).call(Op.CALL_TRANSFORM, PLACE) == callback_slot.ASKING


def test_numbers_of_calls_fit_a_message_and_are_never_none(words) -> None:
    called = CallbackSlot(words)
    called.number = 2**31 - 2
    numbers = []
    for _ in range(3):
        called.call(Op.SIGNAL, PLACE)
        numbers.append(called.number)
    assert numbers == [2**31 - 1, 1, 2]


def test_without_the_jit_calls_come_by_messages_alone(words, monkeypatch) -> None:
    monkeypatch.setattr(callback_slot, "jit_disabled", lambda: True)
    called = CallbackSlot(words)
    assert called.call(Op.CALL_FUNCTION, PLACE) == callback_slot.UNSEEN
    assert called.number == 0
    assert not words.any()
