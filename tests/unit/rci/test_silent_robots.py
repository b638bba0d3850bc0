"""Robots of control tasks that are not heard of any more, by a clock that stands where a test puts it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from qrobot.errors import LinkTimeout
from qrobot.rci.common_clock import CommonClock
from qrobot.rci.monitor import Monitor

PATIENCE_NS, LOOK_NS = 2_000, 250


class Listening(Monitor):
    """Has one task with a robot, which was heard at 0."""

    def __init__(self) -> None:
        super().__init__("host", CommonClock(lambda: 0))
        self.told: list[BaseException] = []
        self.runner: Any = SimpleNamespace(td=SimpleNamespace(name="task"), heard_ns=0, end=self.told.append)
        self.end_silent(0, PATIENCE_NS, LOOK_NS)

    @property
    def attached(self) -> list[Any]:
        return [self.runner]

    def looks(self, *times_ns: int) -> int:
        """It looks at these instants; how often the task was ended."""
        for now_ns in times_ns:
            self.end_silent(now_ns, PATIENCE_NS, LOOK_NS)
        return len(self.told)


def test_a_task_ends_once_its_robot_was_silent_for_longer_than_is_waited() -> None:
    monitor = Listening()
    assert monitor.looks(*range(LOOK_NS, PATIENCE_NS + 1, LOOK_NS)) == 0
    assert monitor.looks(PATIENCE_NS + LOOK_NS) == 1
    with pytest.raises(LinkTimeout, match="task task: the bridge of its robot has fallen silent"):
        raise monitor.told[0]


def test_a_robot_that_speaks_is_never_silent() -> None:
    monitor = Listening()
    for now_ns in range(100, 20 * PATIENCE_NS, 100):
        monitor.runner.heard_ns = now_ns
        assert monitor.looks(now_ns) == 0


@pytest.mark.parametrize("held_up_ns", [PATIENCE_NS, 10 * PATIENCE_NS])
def test_while_nobody_looked_a_robot_was_not_silent(held_up_ns: int) -> None:
    """What it said then may wait to be read; and it gets the rest of its time, where it stood still itself."""
    monitor = Listening()
    assert monitor.looks(LOOK_NS) == 0
    late_ns = 2 * LOOK_NS + held_up_ns
    assert monitor.looks(late_ns) == 0
    rest_ns = PATIENCE_NS - 2 * LOOK_NS
    assert monitor.looks(*range(late_ns + LOOK_NS, late_ns + rest_ns + 1, LOOK_NS)) == 0
    assert monitor.looks(late_ns + rest_ns + LOOK_NS) == 1


def test_a_robot_that_is_heard_after_a_hold_up_is_not_heard_in_the_future() -> None:
    monitor = Listening()
    monitor.runner.heard_ns = 90_000
    assert monitor.looks(100_000) == 0
    assert monitor.runner.heard_ns == 100_000
    assert monitor.looks(*range(100_000 + LOOK_NS, 100_000 + PATIENCE_NS + 1, LOOK_NS)) == 0
    assert monitor.looks(100_000 + PATIENCE_NS + LOOK_NS) == 1
