"""Waits with a bound, of a process that is kept from running for longer than that."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import pytest

from qrobot.errors import LinkTimeout
from qrobot.hwif.memory_bus import MemoryBus
from qrobot.realtime import deadline
from qrobot.realtime.deadline import Deadline, comes_true
from qrobot.servo.operator.client import ServoClient
from qrobot.servo.operator.loop_wait import await_loop

STALL_S = 100.0
Condition = Callable[[], bool]


def of_the_loop(condition: Condition) -> None:
    await_loop(condition)


def of_a_client(condition: Condition) -> None:
    silent = SimpleNamespace(status=lambda: None)
    ServoClient._wait(cast(Any, silent), lambda _status: condition(), 1.0)


def of_a_board(condition: Condition) -> None:
    MemoryBus(cast(Any, None), "the bench")._wait(condition, Deadline(1.0), "takes nothing")


def looks_of(wait: Callable[[Condition], object], monkeypatch: pytest.MonkeyPatch, found: int) -> int:
    """Number of looks of a wait whose process stands still behind each of them, until look `found` finds something."""
    now, looks = [0.0], list[float]()
    monkeypatch.setattr(deadline, "time", SimpleNamespace(monotonic=lambda: now[0], sleep=lambda _: None))

    def look() -> bool:
        looks.append(now[0])
        now[0] += STALL_S
        return len(looks) == found

    wait(look)
    return len(looks)


@pytest.mark.parametrize("wait", [of_the_loop, of_a_client, of_a_board])
def test_what_comes_while_who_waits_is_kept_from_running_is_found(
    wait: Callable[[Condition], object], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert looks_of(wait, monkeypatch, found=2) == 2


@pytest.mark.parametrize("wait", [of_the_loop, of_a_board])
def test_what_has_not_come_then_is_not_waited_for_any_longer(
    wait: Callable[[Condition], object], monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(LinkTimeout, match="run"):
        looks_of(wait, monkeypatch, found=3)


def test_a_wait_of_no_time_is_one_look() -> None:
    looks: list[bool] = []
    assert not comes_true(lambda: looks.append(True), Deadline(0.0), 1.0)
    assert looks == [True]
