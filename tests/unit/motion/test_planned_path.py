"""A path that is planned before it runs: the setpoints that then come, and derivatives that agree with each other."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from qrobot.errors import MotionError
from qrobot.motion import (
    HERE,
    Duration,
    EventKind,
    Generator,
    MotionMode,
    MoveRequest,
    SpeedShare,
    Termination,
    ToolSpeed,
    TransformKind,
    Trsf,
)
from qrobot.motion.path.phase import Phase
from tests.support.motion import LIMITS, ended, generator, run
from tests.support.puma import LIMITS as PUMA_LIMITS
from tests.support.puma import at_park, puma_generator, shift

SLOW = SpeedShare(0.5)


def joint_program() -> Generator:
    gen = generator()
    for name, q in (("a", (1.0, 0.2)), ("b", (0.4, -0.3)), ("stand", None), ("c", (2.0, 0.0))):
        gen.push(MoveRequest(name, HERE if q is None else np.array(q), SLOW))
    return gen


def cartesian_program() -> Generator:
    gen = puma_generator()
    for x, y, mode in (
        (0.05, 0.08, MotionMode.CARTESIAN),
        (0.0, 0.1, MotionMode.CARTESIAN),
        (0.0, 0.0, MotionMode.JOINT),
    ):
        gen.push(MoveRequest("place", at_park(shift(x, y)).goal(), ToolSpeed(0.1, 0.5), mode=mode))
    return gen


def after(ticks: int, act: Callable[[Generator], object]) -> Generator:
    """A joint motion under way, to which something happened."""
    gen = generator()
    gen.push(MoveRequest("a", np.array([1.0, 0.2]), SLOW))
    for tick in range(1, ticks):
        gen.update(tick)
    act(gen)
    return gen


PROGRAMS = {
    "joints": joint_program,
    "tool": cartesian_program,
    "path stop": lambda: after(20, lambda gen: gen.stop(0.5)),
    "joint stop": lambda: after(20, lambda gen: gen.abort(Termination.SINGULAR)),
    "under way": lambda: after(25, lambda gen: gen.push(MoveRequest("b", np.array([0.0, 0.0]), SLOW))),
    "nothing": generator,
}


@pytest.mark.parametrize("program", PROGRAMS.values(), ids=PROGRAMS)
def test_the_path_is_that_of_the_setpoints_that_then_run_to_the_bit(program) -> None:
    gen, unasked = program(), program()
    path = gen.plan()
    tick = begin = gen._trajectory.tick
    for t, q in zip(path.t[1:], path.q[1:], strict=True):
        tick += 1
        output = gen.update(tick)
        assert (output.q == unasked.update(tick).q).all()
        assert (output.q == q).all()
        assert (path.at(t)[0] == q).all()
        assert (path.at((tick - begin) * gen.period_s)[0] == q).all()
    assert not gen.busy
    assert path.duration_s == pytest.approx((tick - begin) * gen.period_s)


@pytest.mark.parametrize(("program", "limits"), [(joint_program, LIMITS), (cartesian_program, PUMA_LIMITS)])
def test_velocity_and_acceleration_are_the_derivatives_of_position(program, limits) -> None:
    path = program().plan()
    h = 1e-5
    for t in np.arange(0.2 * path.period_s, path.duration_s - path.period_s, 0.37 * path.period_s):
        before, now, later = (path.at(t + step) for step in (-h, 0.0, h))
        assert np.abs((later[0] - before[0]) / (2.0 * h) - now[1]).max() <= 1e-3 * limits.v_max.max()
        assert np.abs((later[1] - before[1]) / (2.0 * h) - now[2]).max() <= 0.02 * limits.a_max.max()


@pytest.mark.parametrize("program", PROGRAMS.values(), ids=PROGRAMS)
def test_positions_and_velocities_do_not_jump_anywhere(program) -> None:
    path = program().plan()
    times = np.linspace(0.0, path.duration_s, 997)
    table, step_s = path.table(times), times[1]
    assert np.abs(np.diff(table[:, 0], axis=0)).max() <= 2.0 * step_s * max(PUMA_LIMITS.v_max.max(), 1.5)
    assert np.abs(np.diff(table[:, 1], axis=0)).max() <= 1.5 * step_s * max(PUMA_LIMITS.a_max.max(), 10.0) + 1e-6


@pytest.mark.parametrize("program", [joint_program, lambda: after(20, lambda gen: gen.stop(0.5))])
def test_the_state_at_each_sample_is_that_of_the_generator(program) -> None:
    gen = program()
    path, tick = gen.plan(), gen._trajectory.tick
    for t in path.t[1:]:
        tick += 1
        gen.update(tick)
        np.testing.assert_allclose(path.at(t), gen.state(), atol=1e-9)


def test_what_will_happen_is_known_with_its_time() -> None:
    gen = joint_program()
    path = gen.plan()
    ends = [(t, event.request.name) for t, event in path.events if event.kind is EventKind.ENDED]
    outputs = list(run(gen))
    assert [name for _, name in ends] == [name for name, _ in ended(outputs)] == ["a", "b", "stand", "c"]
    times = [k * gen.period_s for k, output in enumerate(outputs, 1) if ended([output])]
    assert sorted({t for t, _ in ends}) == pytest.approx(times)


def test_monitors_are_not_called_and_nothing_of_the_generator_changes() -> None:
    called = []
    gen = generator()
    gen.push(MoveRequest("a", np.array([1.0, 0.0]), SLOW, monitor=lambda: called.append(1)))
    before = gen.state()
    gen.plan()
    assert not called
    assert (gen.state() == before).all()
    assert (gen.phase, gen.waiting, gen.serving) == (Phase.RESTING, 1, None)


@pytest.mark.parametrize("serving", [False, True], ids=["waits", "is served"])
def test_a_path_to_a_goal_that_moves_is_refused_by_its_name(serving) -> None:
    belt = Trsf("belt", TransformKind.FUNCTION, function=lambda _: None)
    goal = at_park(belt, shift(y=0.05))
    gen = puma_generator()
    gen.push(MoveRequest("conveyor", goal.goal(), ToolSpeed(0.1, 0.5), mode=MotionMode.CARTESIAN))
    for tick in range(1, 8 if serving else 1):
        gen.update(tick)
    with pytest.raises(MotionError, match=r"path to conveyor cannot be planned .* the goal moves"):
        gen.plan()


@pytest.mark.parametrize("t", [-0.001, 1e9, np.nan])
def test_a_time_outside_the_path_is_refused(t) -> None:
    with pytest.raises(MotionError, match="lasts from 0 to"):
        joint_program().plan().at(t)


def test_a_dwell_is_part_of_the_path() -> None:
    gen = generator()
    gen.push(MoveRequest("stay", np.zeros(2), Duration(0.56), 0.0))
    path = gen.plan()
    assert path.duration_s == pytest.approx(0.56, abs=2 * path.period_s)
    assert not path.table(path.t).any()


@pytest.mark.parametrize("t", ["x", None, True])
def test_a_time_that_is_no_number_is_refused(t) -> None:
    path = joint_program().plan()
    for call in (lambda: path.at(t), lambda: path.table([0.0, t])):
        with pytest.raises(MotionError, match="a time in seconds is needed"):
            call()


def test_a_table_of_no_times_has_no_rows() -> None:
    assert joint_program().plan().table(np.empty(0)).shape == (0, 3, 2)
