"""`stop` of Multi-RCCL, of an arm and of a frame: it stands where the motion before it has ended, however that was."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import count, pairwise

import numpy as np
import pytest

from qrobot import rci
from qrobot.arrays import Floats
from qrobot.multi_rccl import (
    EQ,
    TL,
    TRANS,
    Manip,
    cancel,
    distance,
    evalfn,
    make_position,
    move,
    rccl_control,
    rccl_open,
    setvel,
    stop,
    wait_as,
    wait_for,
)
from qrobot.multi_rccl.program import _program
from qrobot.rccl import Position, Transform, gentr_rpy, gentr_trsl
from qrobot.rccl.offline import OfflineLink
from qrobot.rccl.program import ending
from qrobot.rccl.transforms import assigntr

PERIOD_MS = 28.0
STAY_MS = 500.0
ENDED = 7
Way = Callable[[Manip, Position], None]

tool = gentr_trsl("TOOL", 0, 0, 150)


def place_at(manip: Manip, where: Transform) -> Position:
    """Its own pose, or that of its tool, at `where`."""
    chain = (TRANS, tool) if manip.name == "left" else (TRANS,)
    return make_position(*chain, EQ, where, TL, chain[-1])


@pytest.fixture(params=["left", "OBJECT_FRAME"])
def manip(request) -> Iterator[Manip]:
    """An arm, or a frame beside an arm, somewhere."""
    token = _program.set(None)
    with rci.use(OfflineLink), ending():
        opened = [rccl_open(name) for name in dict.fromkeys(("left", request.param))]
        for each in opened:
            rccl_control(each)
        setvel(opened[-1], 200, 90)
        move(opened[-1], place_at(opened[-1], gentr_rpy("HERE", 500, 0, 0, 0, 180, 0)))
        wait_for(opened[-1].completed)
        yield opened[-1]
    _program.reset(token)


def course(manip: Manip) -> Floats:
    """Its poses at all samples until it has nothing to do. Shape (k, 4, 4)."""
    poses: list[Floats] = []
    wait_as(lambda: (poses.append(manip.trans.value.copy()), not manip.eventful)[1])
    return np.array(poses)


def rests(poses: Floats) -> list[tuple[float, Floats]]:
    """How long it stood between two motions, ms, and where."""
    still = np.abs(np.diff(poses, axis=0)).max(axis=(1, 2)) < 1e-12
    moving = np.flatnonzero(~still)
    return [
        ((after - before - 1) * PERIOD_MS, poses[before + 1])
        for before, after in pairwise(moving)
        if after - before > 3
    ]


def some_samples(manip: Manip, samples: int) -> None:
    passed = count()
    wait_as(lambda: next(passed) >= samples)


def completed(manip: Manip, position: Position) -> None:
    move(manip, position)


def short_of_it(manip: Manip, position: Position) -> None:
    distance(manip, "dz", -10)
    move(manip, position)


def guarded(manip: Manip, position: Position) -> None:
    samples = count()
    evalfn(manip, lambda: ENDED if next(samples) == 25 else 0)
    move(manip, position)


def cancelled(manip: Manip, position: Position) -> None:
    move(manip, position)
    some_samples(manip, 25)
    cancel(manip)


def skipped(manip: Manip, position: Position) -> None:
    move(manip, position)
    some_samples(manip, 25)
    manip.skip(ENDED)


def elsewhere_by_now(manip: Manip, position: Position) -> None:
    move(manip, position)
    assigntr(position.equation.right[0], gentr_rpy("B", 460, -40, 60, 0, 180, 0))


@pytest.mark.sampled(6)
@pytest.mark.parametrize(
    ("way", "exact"),
    [
        (completed, 0.0),
        (short_of_it, 0.01),
        (elsewhere_by_now, 0.0),
        (guarded, None),
        (cancelled, None),
        (skipped, None),
    ],
)  # fmt: skip
def test_a_stop_for_a_time_is_where_the_motion_before_it_has_ended(manip, way: Way, exact: float | None) -> None:
    position = place_at(manip, gentr_rpy("LOC", 480, 80, 120, 0, 180, 0, "hold"))
    goal, home = position.equation.goal().pose(0), place_at(manip, gentr_rpy("HOME", 500, 0, 0, 0, 180, 0))
    way(manip, position)
    stop(manip, ms=STAY_MS)
    move(manip, home)
    ((ms, where),) = rests(course(manip))
    assert STAY_MS <= ms <= STAY_MS + 8 * PERIOD_MS
    off = float(np.linalg.norm((where - goal)[:3, 3]))
    if exact is None:
        assert off > 0.02
    else:
        assert off == pytest.approx(exact, abs=1e-9)


@pytest.mark.parametrize(("way", "ended"), [("short of it", False), ("guarded", True)])
def test_a_stop_at_a_position_goes_there_as_a_motion_does_and_stands(manip, way: str, ended: bool) -> None:
    position = place_at(manip, gentr_rpy("LOC", 480, 80, 120, 0, 180, 0))
    goal, home = position.equation.goal().pose(0), place_at(manip, gentr_rpy("HOME", 500, 0, 0, 0, 180, 0))
    samples = count()
    if ended:
        evalfn(manip, lambda: ENDED if next(samples) == 25 else 0)
    else:
        distance(manip, "dz", -10)
    stop(manip, position, STAY_MS)
    move(manip, home)
    ((ms, where),) = rests(course(manip))
    assert STAY_MS <= ms <= STAY_MS + 8 * PERIOD_MS
    off = float(np.linalg.norm((where - goal)[:3, 3]))
    assert off > 0.02 if ended else off == pytest.approx(0.01, abs=1e-9)
    assert position.code == (ENDED if ended else -1)


def test_what_was_said_for_the_next_motion_is_for_no_stop(manip) -> None:
    position = place_at(manip, gentr_rpy("LOC", 480, 80, 120, 0, 180, 0))
    goal, asked = position.equation.goal().pose(0), []
    distance(manip, "dz", -10)
    evalfn(manip, lambda: asked.append(1))
    stop(manip, ms=STAY_MS)
    wait_for(manip.completed)
    assert not asked
    move(manip, position)
    wait_for(manip.completed)
    assert asked
    assert float(np.linalg.norm((manip.trans.value - goal)[:3, 3])) == pytest.approx(0.01, abs=1e-9)


def test_a_stop_that_stands_is_over_when_it_is_cancelled_or_skipped(manip) -> None:
    home = place_at(manip, gentr_rpy("HOME", 500, 0, 60, 0, 180, 0))
    for way in (cancel, lambda manip: manip.skip(ENDED)):
        stop(manip, ms=100_000)
        some_samples(manip, 20)
        way(manip)
        wait_for(manip.completed)
    stop(manip, ms=100_000)
    move(manip, home)
    some_samples(manip, 20)
    manip.skip(ENDED)
    wait_for(home.end)
    assert manip.trans.value == pytest.approx(home.equation.goal().pose(0), abs=1e-9)
