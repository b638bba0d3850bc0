"""A small arm of two joints, one of them sliding, and helpers that run a generator."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import count

import numpy as np

from qrobot.motion import Blend, EventKind, Generator, MotionLimits, Output

PERIOD_S = 0.028
LIMITS = MotionLimits(
    q_min=np.array([-2.0, -0.5]),
    q_max=np.array([3.0, 0.5]),
    v_max=np.array([1.5, 0.4]),
    a_max=np.array([10.0, 3.0]),
    a_stop=np.array([8.0, 2.5]),
    prismatic=np.array([False, True]),
    names=("waist", "slide"),
)


def generator(q: tuple[float, ...] = (0.0, 0.0), period_s: float = PERIOD_S, blend: Blend = Blend.QUARTIC) -> Generator:
    return Generator(LIMITS, period_s, np.array(q), blend=blend)


def run(gen: Generator, at_tick: Callable[[int], object] | None = None) -> Iterator[Output]:
    """Outputs until the generator is idle; `at_tick` may interfere before each sample."""
    for tick in count(1):
        if at_tick is not None:
            at_tick(tick)
        output = gen.update(tick)
        yield output
        if any(event.kind is EventKind.IDLE for event in output.events):
            return


def ended(outputs: list[Output]) -> list[tuple[str, int]]:
    """Names and codes of the requests that ended, in order."""
    events = [event for output in outputs for event in output.events]
    return [(event.request.name, event.code) for event in events if event.request and event.kind is EventKind.ENDED]
