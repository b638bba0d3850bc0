"""What a program and the process of its generator share, and what crosses between them."""

from __future__ import annotations

import gc

import numpy as np
import pytest

from qrobot.errors import MotionError
from qrobot.model.transform import transform
from qrobot.motion import T6, Compliance, Drift, Goal, TransformKind, Trsf
from qrobot.rccl import EQ, TL, gentr_trsl, makeposition, newtrans, t6
from qrobot.rccl.process.carried import GeneratorEnd, ProgramEnd
from qrobot.rccl.process.shared_values import CELLS, GENERATOR, PROGRAM, ValueCells


def both() -> tuple[ProgramEnd, GeneratorEnd]:
    """Two ends in one process, which map the same memory."""
    ours = ValueCells(PROGRAM)
    there = GeneratorEnd(ValueCells(GENERATOR, ours.fd))
    return ProgramEnd(ours, there.part), there


def moved(x: float) -> np.ndarray:
    return transform(translation=np.array([x, 0.0, 0.0]))


def test_the_value_that_was_given_last_counts_at_both_ends_whoever_gave_it() -> None:
    ours = ValueCells(PROGRAM)
    here, there = ours.cell(3), ValueCells(GENERATOR, ours.fd).cell(3)
    for giver, x in ((here, 1.0), (there, 2.0), (there, 3.0), (here, 4.0), (here, 5.0), (there, 6.0)):
        giver.set(moved(x))
        assert np.array_equal(here.get(), moved(x))
        assert np.array_equal(there.get(), moved(x))


def test_while_a_value_is_being_written_that_of_before_counts() -> None:
    ours = ValueCells(PROGRAM)
    here, there = ours.cell(0), ValueCells(GENERATOR, ours.fd).cell(0)
    here.set(moved(1.0))
    assert np.array_equal(there.get(), moved(1.0))
    here._mine.sequence += 1  # a writer is inside, and may have died there
    here._mine.content[3] = 9.0
    assert np.array_equal(there.get(), moved(1.0))
    here.set(moved(2.0))
    assert np.array_equal(there.get(), moved(2.0))


def test_a_goal_crosses_with_the_transforms_of_its_program_and_not_with_copies() -> None:
    program, generator = both()
    belt, pin = newtrans("BELT"), gentr_trsl("PIN", 10, 0, 0)
    goal = makeposition("P", t6, EQ, belt, pin, TL, pin).equation.goal()
    there: Goal = generator.loads(program.dumps(goal))
    assert np.array_equal(there.pose(0), goal.pose(0))
    belt.p.x = 250.0
    assert there.pose(1)[0, 3] == pytest.approx(0.26)
    assert there.equation is None
    assert generator.loads(program.dumps(T6)) is T6


def test_motions_of_an_arm_that_comply_share_one_drift_in_the_generator() -> None:
    program, generator = both()
    drift = Drift()
    first, second = (generator.loads(program.dumps(Compliance(np.zeros(6), (axis,), drift))) for axis in (0, 2))
    assert first.drift is second.drift
    first.drift.values[0] = 0.1
    assert first.transform.at(0)[0, 3] == pytest.approx(0.1)


def test_a_transform_with_a_function_is_refused_by_name() -> None:
    program, _ = both()
    with pytest.raises(MotionError, match="transform SPIN has a function"):
        program.dumps(Trsf("SPIN", TransformKind.FUNCTION, function=lambda _: None))


def test_places_of_transforms_that_are_gone_are_used_again_and_motions_keep_what_they_were() -> None:
    program, generator = both()
    first = newtrans("FIRST")
    first.p.x = 5.0
    twin: Trsf = generator.loads(program.dumps(first))
    del first
    gc.collect()
    kept = [newtrans(f"T{k}") for k in range(CELLS)]
    for trsf in kept:  # the last one takes the place of the first of all
        trsf.p.x = 7.0
        generator.loads(program.dumps(trsf))
    assert twin.value[0, 3] == pytest.approx(0.005)
    with pytest.raises(MotionError, match=f"motions name {CELLS} transforms already"):
        program.dumps(newtrans("ONE MORE"))
