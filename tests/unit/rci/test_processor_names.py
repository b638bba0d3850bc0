"""What a program is told of the processors that it may have."""

from __future__ import annotations

import os
from errno import EPERM
from typing import NoReturn

import pytest

from qrobot.rci.processor_names import processors
from qrobot.realtime.setup import SetupStep


def refuse(*_: object) -> NoReturn:
    raise PermissionError(EPERM, os.strerror(EPERM))


def test_a_scheduler_that_is_refused_stands_in_the_description_of_each_processor(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    found = processors()
    assert {"host", "aux", "compiled"} < {info.name for info in found}
    for info in found:
        assert info.description.endswith(f"(SCHED_FIFO 20 refused: [Errno 1] {os.strerror(EPERM)})")
        assert info.available  # tasks run there all the same


def test_of_one_that_is_granted_nothing_is_said_and_who_asks_stays_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("qrobot.rci.processor_names.set_fifo", lambda _: SetupStep("scheduler", True, "SCHED_FIFO 20"))
    before = os.sched_getscheduler(0)
    assert not any("SCHED_FIFO" in info.description for info in processors())
    assert os.sched_getscheduler(0) == before
