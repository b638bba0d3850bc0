"""A motion that another follows is guarded until it has ended, which is in the middle of the transition."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.motion import EventKind, Generator, MotionMode, MoveRequest, Output, Termination, ToolSpeed
from tests.support.motion import ended, run
from tests.support.puma import at_park, puma_generator, shift

SPEED = ToolSpeed(0.2, 1.0)
DONE = Termination.COMPLETED
modes = pytest.mark.parametrize("mode", list(MotionMode))


class Watch:
    """A monitor that answers with 7 when it is called for the `nth` time, and notes the samples of its calls."""

    def __init__(self, nth: int = 0) -> None:
        self.tick, self.nth = 0, nth
        self.calls: list[int] = []

    def __call__(self) -> int:
        self.calls.append(self.tick)
        return 7 if len(self.calls) == self.nth else 0

    def at(self, tick: int) -> None:
        self.tick = tick


def corner(mode: MotionMode, first: Watch | None, second: Watch | None = None) -> Generator:
    """A generator that is to turn round the goal of "a" on its way to that of "b"."""
    gen = puma_generator()
    for name, way, watch in (("a", shift(y=0.2), first), ("b", shift(y=0.2, z=0.2), second)):
        goal = at_park(way).goal()
        gen.push(MoveRequest(name, goal, SPEED, mode=mode, monitor=watch))
    return gen


def tick_of(outputs: list[Output], kind: EventKind, name: str) -> int:
    (tick,) = (
        tick
        for tick, output in enumerate(outputs, 1)
        for event in output.events
        if event.kind is kind and event.request is not None and event.request.name == name
    )
    return tick


@modes
def test_both_monitors_are_called_in_the_first_half_of_a_transition(mode: MotionMode) -> None:
    first, second = Watch(), Watch()
    outputs = list(run(corner(mode, first, second), lambda tick: (first.at(tick), second.at(tick))))
    begun, passed = tick_of(outputs, EventKind.BEGUN, "b"), tick_of(outputs, EventKind.ENDED, "a")
    assert passed - begun >= 5
    assert first.calls == list(range(tick_of(outputs, EventKind.BEGUN, "a") + 1, passed + 1))
    assert second.calls[:20] == list(range(begun + 1, begun + 21))
    assert ended(outputs) == [("a", DONE), ("b", DONE)]


@modes
def test_what_ends_a_motion_in_its_last_half_transition_tells_its_code_and_the_arm_goes_the_same_way(
    mode: MotionMode,
) -> None:
    free = Watch()
    plain = list(run(corner(mode, free), free.at))
    half = tick_of(plain, EventKind.ENDED, "a") - tick_of(plain, EventKind.BEGUN, "b")
    for nth in range(len(free.calls) - half + 1, len(free.calls) + 1):
        watch = Watch(nth)
        outputs = list(run(corner(mode, watch), watch.at))
        assert ended(outputs) == [("a", 7), ("b", DONE)]
        assert tick_of(outputs, EventKind.ENDED, "a") == free.calls[nth - 1]
        assert len(watch.calls) == nth
        assert np.array_equal([output.q for output in outputs], [output.q for output in plain])


@modes
def test_the_monitor_of_the_motion_that_begins_ends_that_one_alone(mode: MotionMode) -> None:
    first, second = Watch(), Watch(nth=2)
    outputs = list(run(corner(mode, first, second), lambda tick: (first.at(tick), second.at(tick))))
    assert ended(outputs) == [("a", DONE), ("b", 7)]
