"""Arms that move together: which of their samples are of one instant."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, cast

import pytest

from qrobot.errors import MotionError
from qrobot.rccl.task_group import MOST_APART, TaskGroup


@dataclass(eq=False)
class FakeTask:
    """A task that has its arm under control at a sample of its own count."""

    tick: int
    period_number: int | None
    period_s: float = 0.028
    followed: None = None

    def count_from(self, tick: int) -> None:
        self.tick = max(self.tick, tick)

    def join(self, group: TaskGroup) -> int:
        """Sample of the others that counts as its newest."""
        group.join(cast(Any, self))
        return self.tick


@dataclass
class Frame:
    """A member that notes the samples at which it is evaluated."""

    seen: list[int] = field(default_factory=list)

    def before_sample(self, tick: int) -> None:
        self.seen.append(tick)


@pytest.mark.parametrize("number", [7_000, (1 << 32) - 3], ids=["", "across the wrap of numbers"])
@pytest.mark.parametrize("later", [49, 50, 51, 50 - MOST_APART])
def test_samples_of_one_period_of_the_shared_clock_have_one_number(number: int, later: int) -> None:
    group = TaskGroup()
    first = FakeTask(30, number).join(group)
    group.before_sample(first + 50)  # so far the first arm has come; the other is asked a little before or after it
    assert FakeTask(20, (number + later) % (1 << 32)).join(group) == max(20, first + later)


@pytest.mark.parametrize("far", [MOST_APART + 1, -MOST_APART - 1, 1 << 30])
def test_an_arm_on_another_clock_counts_from_the_newest_sample(far: int) -> None:
    group = TaskGroup()
    group.before_sample(FakeTask(30, 7_000).join(group) + 500)
    assert FakeTask(20, 7_500 + far).join(group) == 530
    assert FakeTask(20, None).join(group) == 530


def test_a_clock_is_forgotten_with_the_last_arm() -> None:
    group, first = TaskGroup(), FakeTask(30, 7_000)
    first.join(group)
    group.leave(cast(Any, first))
    group.before_sample(40)
    assert FakeTask(20, 6_990).join(group) == 40
    with pytest.raises(MotionError, match=r"28 ms and 14 ms"):
        FakeTask(20, None, 0.014).join(group)


def test_samples_that_one_arm_has_left_out_are_evaluated_for_the_others() -> None:
    group, frame = TaskGroup(), Frame()
    group.members.append(cast(Any, frame))
    far = 14 + 3 * MOST_APART
    for tick in (1, 4, 3, 5, far):
        group.before_sample(tick)
    assert frame.seen == [1, 2, 3, 4, 3, 5, *range(far - MOST_APART, far + 1)]
