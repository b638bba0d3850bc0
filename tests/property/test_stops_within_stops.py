"""A stop that was to take its time, and becomes a shorter one at any instant: on its path, smoothly and soon."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot.arrays import Floats
from qrobot.motion import Blend, Generator, JointSpeed, MoveRequest, SpeedShare, Termination
from qrobot.motion.path.phase import Phase
from tests.support.motion import LIMITS, ended, generator, run
from tests.support.thorough import examples

FINE_S = 0.005  # at this period differences of states say what the derivatives are
SOON = round(0.5 / FINE_S)  # samples: no shortest stop of this arm takes longer
ROUNDING = 1e-9
STOPPED = int(Termination.STOPPED)
TARGETS = st.tuples(st.floats(-2.0, 3.0), st.floats(-0.5, 0.5))
PACES = st.one_of(st.builds(SpeedShare, st.floats(0.2, 1.0)), st.builds(JointSpeed, st.floats(0.05, 0.4)))
MOVES = st.builds(MoveRequest, st.just("there"), TARGETS.map(np.array), PACES)
DEEDS: dict[str, tuple[Callable[[Generator], None], int]] = {
    "stop": (lambda gen: gen.stop(), STOPPED),
    "a shorter stop": (lambda gen: gen.stop(0.2), STOPPED),
    "a limit": (lambda gen: gen.skip(Termination.FORCE_LIMIT), int(Termination.FORCE_LIMIT)),
    "abort": (lambda gen: gen.abort(Termination.SINGULAR), STOPPED),
}


def assert_smooth(before: Floats, after: Floats) -> None:
    """A step of the state agrees with its derivatives, and keeps the limits."""
    assert (np.abs(after[1]) <= LIMITS.v_max * (1.0 + ROUNDING)).all()
    assert (np.abs(after[2]) <= LIMITS.a_max * (1.0 + ROUNDING)).all()
    assert np.abs(after[0] - before[0] - FINE_S * before[1]).max() <= LIMITS.a_max.max() * FINE_S**2
    assert (np.abs(after[1] - before[1]) <= LIMITS.a_max * FINE_S + ROUNDING).all()


@given(
    move=MOVES,
    override=st.sampled_from((1.0, 0.4)),
    seconds=st.floats(0.3, 60.0),
    begin=st.integers(2, 150),
    later=st.integers(0, 150),
    deed=st.sampled_from(sorted(DEEDS)),
    blend=st.sampled_from(Blend),
)
@settings(max_examples=examples(80), deadline=None)
def test_a_stop_becomes_a_shorter_one_on_its_path_within_the_limits(
    move, override, seconds, begin, later, deed, blend
) -> None:
    gen = generator(period_s=FINE_S, blend=blend)
    gen.override = override
    gen.push(move)
    do, code = DEEDS[deed]
    before, ends = gen.state(), []

    def interfere(tick: int) -> None:
        if tick == begin:
            gen.stop(seconds)
        if tick == begin + later and gen.stopping:
            state = gen.state()
            do(gen)
            assert gen.state() == pytest.approx(state, abs=ROUNDING)
            ends.append(gen._sequencer.last_end())

    outputs = []
    for output in run(gen, interfere):
        state = gen.state()
        assert_smooth(before, state)
        before = state
        outputs.append(output)
    q = np.array([output.q for output in outputs])
    assert np.abs(q[:, 0] * move.target[1] - q[:, 1] * move.target[0]).max() <= ROUNDING  # on the line from 0
    assert [name for name, _ in ended(outputs)] == ["there"]
    assert ended(outputs)[0][1] in (code, STOPPED, Termination.COMPLETED)
    if ends:
        assert len(outputs) - (begin + later) <= SOON
        assert q[-1] == pytest.approx(ends[0], abs=ROUNDING)


def nothing(gen: Generator, tick: int) -> None:
    """Let the stop take its time."""


def stopped_slowly(
    at_tick: Callable[[Generator, int], object] = nothing, seconds: float = 5.0, monitor=None
) -> tuple[int, int]:
    """Samples that a motion takes which is stopped in `seconds` before sample 20, and the code that it ends with."""
    gen = generator()
    gen.push(MoveRequest("there", np.array([2.0, 0.2]), JointSpeed(0.3), monitor=monitor))

    def interfere(tick: int) -> None:
        if tick == 20:
            gen.stop(seconds)
        at_tick(gen, tick)

    outputs = list(run(gen, interfere))
    ((_, code),) = ended(outputs)
    return len(outputs), code


@pytest.mark.parametrize("deed", DEEDS)
def test_what_asks_for_haste_in_a_stop_of_seconds_is_heard(deed) -> None:
    do, code = DEEDS[deed]
    samples, told = stopped_slowly(lambda gen, tick: do(gen) if tick == 30 else None)
    assert samples <= 40
    assert told == code
    assert stopped_slowly() == (198, STOPPED)


def test_a_monitor_ends_a_stop_of_seconds_with_its_code() -> None:
    calls = []

    def monitor() -> int:
        calls.append(7)
        return 7 if len(calls) >= 30 else 0

    samples, code = stopped_slowly(monitor=monitor)
    assert samples <= 40
    assert code == 7


@pytest.mark.parametrize("deed", DEEDS)
@pytest.mark.parametrize("seconds", [0.0, 0.15])
def test_what_asks_for_haste_again_and_again_changes_nothing_of_a_stop_that_has_none_to_gain(seconds, deed) -> None:
    do, _ = DEEDS[deed]
    once = stopped_slowly(seconds=seconds)
    hurried = stopped_slowly(lambda gen, tick: do(gen) if tick > 20 else None, seconds)
    assert hurried[0] <= once[0]
    if seconds == 0.0:
        assert hurried == once


def test_a_longer_stop_does_not_lengthen_one_that_is_under_way() -> None:
    later = stopped_slowly(lambda gen, tick: gen.stop(9.0) if tick > 20 else None, 2.0)
    assert later == stopped_slowly(seconds=2.0)


def test_a_stop_that_becomes_a_shorter_one_is_still_a_stop_on_the_path() -> None:
    phases: list[Phase] = []

    def at_tick(gen: Generator, tick: int) -> None:
        phases.append(gen.phase)
        if tick == 30:
            gen.stop()

    stopped_slowly(at_tick)
    assert list(dict.fromkeys(phases)) == [Phase.RESTING, Phase.MOVING, Phase.PATH_STOP]
