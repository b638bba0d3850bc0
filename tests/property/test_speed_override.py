"""Speed override at random instants: the same places in the same order, smoothly and within the limits."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from itertools import pairwise
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot.errors import MotionError
from qrobot.motion import Generator, JointSpeed, MotionMode, MoveRequest, SpeedShare, Termination
from qrobot.motion.path.phase import Phase
from qrobot.motion.trajectory.speed_override import SHARE, SpeedOverride
from tests.support.motion import LIMITS, PERIOD_S, ended, generator, run
from tests.support.puma import LIMITS as ARM_LIMITS
from tests.support.puma import PARK, Conveyor, arm, at_park, puma_generator, shift
from tests.support.thorough import examples

DONE = (int(Termination.COMPLETED),)
PLACES = st.lists(
    st.tuples(st.floats(-1.8, 2.8), st.floats(-0.45, 0.45), st.sampled_from((None, 0.3, 0.6))),
    min_size=1, max_size=4,
)  # fmt: skip
CHANGES = st.lists(
    st.tuples(st.integers(2, 90), st.one_of(st.just(0.0), st.just(1.0), st.floats(0.0, 1.0))), max_size=6
)
ROUNDING = 1e-9


def changing(gen: Generator, changes: list[tuple[int, float]], resumed: int = 400) -> Callable[[int], None]:
    """Sets the override at the samples named, each so many after the one before; at last it is 1 again."""
    at, tick = {}, 0
    for after, factor in changes:
        tick += after
        at[tick] = factor
    at[tick + resumed] = 1.0

    def at_tick(now: int) -> None:
        if now in at:
            gen.override = at[now]

    return at_tick


def joint_program(gen: Generator, places: list[tuple[float, float, float | None]]) -> None:
    for k, (waist, slide, transition_s) in enumerate(places):
        gen.push(MoveRequest(f"{k}", np.array([waist, slide]), SpeedShare(1.0), transition_s))


@given(PLACES, CHANGES)
@settings(max_examples=examples(120), deadline=None)
def test_joint_motions_pass_the_same_places_at_any_override_within_the_limits(places, changes) -> None:
    nominal, gen = generator(), generator()
    joint_program(nominal, places)
    joint_program(gen, places)
    path = nominal.plan()
    at_tick, clocks, states = changing(gen, changes), [], []

    def each(tick: int) -> None:
        at_tick(tick)
        clocks.append(gen._trajectory.clock)
        states.append(gen.state())

    outputs = list(run(gen, each))
    assert ended(outputs) == ended(list(run(nominal)))
    for clock, state in zip(clocks, states, strict=True):
        t = clock * PERIOD_S
        wanted = path.at(min(t, path.duration_s))[0]
        assert state[0] == pytest.approx(wanted, abs=ROUNDING)
        assert (np.abs(state[1]) <= LIMITS.v_max * (1.0 + ROUNDING)).all()
        assert (np.abs(state[2]) <= LIMITS.a_max * (1.0 + ROUNDING)).all()
    for before, after in pairwise(states):  # continuity: what a sample can change at all
        assert (np.abs(after[1] - before[1]) <= LIMITS.a_max * PERIOD_S * (1.0 + ROUNDING)).all()


@given(st.lists(st.tuples(*[st.floats(-0.1, 0.1)] * 3, st.floats(-0.4, 0.4)), min_size=1, max_size=3), CHANGES)
@settings(max_examples=examples(25), deadline=None)
def test_straight_lines_stay_straight_at_any_override(places, changes) -> None:
    nominal, gen = puma_generator(), puma_generator()
    for each in (nominal, gen):
        for k, place in enumerate(places):
            each.push(MoveRequest(f"{k}", at_park(shift(*place)).goal(), SpeedShare(0.6), mode=MotionMode.CARTESIAN))
    path, at_tick, clocks = nominal.plan(), changing(gen, changes), []

    def each_sample(tick: int) -> None:
        at_tick(tick)
        clocks.append(gen._trajectory.clock)

    outputs = list(run(gen, each_sample))
    assert {code for _, code in ended(outputs)} <= set(DONE)
    start = arm().forward(PARK)
    for clock, output in zip(clocks[1:], outputs, strict=False):
        wanted = arm().forward(path.at(min(clock * PERIOD_S, path.duration_s))[0])
        assert arm().forward(output.q)[:3] == pytest.approx(wanted[:3], abs=1e-6), start


def test_the_speed_as_programmed_is_the_same_to_the_bit() -> None:
    plain, told = generator(), generator()
    for gen in (plain, told):
        joint_program(gen, [(1.0, 0.2, None), (-1.0, -0.3, 0.2)])

    def say(_: int) -> None:
        told.override = 1.0

    assert [o.q.tobytes() for o in run(plain)] == [o.q.tobytes() for o in run(told, say)]


def test_half_the_override_takes_twice_the_time_and_none_takes_none_of_the_path() -> None:
    gen = generator()
    joint_program(gen, [(2.0, 0.0, None)])
    nominal = gen.plan().duration_s
    gen.override = 0.5
    assert len(list(run(gen))) * PERIOD_S == pytest.approx(2.0 * nominal, abs=3 * PERIOD_S)
    joint_program(gen, [(0.0, 0.0, None)])
    gen.override = 0.0
    stands = [gen.update(gen._trajectory.tick + 1) for _ in range(50)]
    assert all(output.q.tolist() == stands[0].q.tolist() and output.moving for output in stands)
    gen.override = 1.0
    assert gen.plan().duration_s == pytest.approx(nominal, abs=2 * PERIOD_S)


@pytest.mark.parametrize("way", ["stop", "abort", "skip"])
@pytest.mark.parametrize("factor", [0.0, 0.1, 0.5])
def test_stops_at_another_speed_are_smooth_and_within_the_limits(way: str, factor: float) -> None:
    gen = generator()
    joint_program(gen, [(2.5, 0.4, None), (-1.5, -0.4, None)])
    states = []

    def at_tick(tick: int) -> None:
        if tick == 10:
            gen.override = factor
        if tick == 24:  # the change is still under way
            {"stop": gen.stop, "abort": lambda: gen.abort(7), "skip": lambda: gen.skip(3)}[way]()
        if tick == 200:
            gen.override = 1.0
        states.append(gen.state())

    outputs = list(run(gen, at_tick))
    assert dict(ended(outputs))["0"] == {"stop": int(Termination.STOPPED), "abort": 7, "skip": 3}[way]
    for state in states:
        assert (np.abs(state[1]) <= LIMITS.v_max * (1.0 + ROUNDING)).all()
        assert (np.abs(state[2]) <= LIMITS.a_max * (1.0 + ROUNDING)).all()
    path = np.array([output.q for output in outputs])
    steps = np.abs(np.diff(path, n=2, axis=0)) / PERIOD_S**2
    assert (steps <= LIMITS.a_max * (1.0 + ROUNDING)).all()


def test_a_skip_while_paused_goes_on_to_the_next_motion_when_it_is_resumed() -> None:
    gen = generator()
    joint_program(gen, [(2.5, 0.4, None), (-1.5, -0.4, None)])

    def at_tick(tick: int) -> None:
        if tick in (10, 300):
            gen.override = 0.0 if tick == 10 else 1.0
        if tick == 150:
            gen.skip(3)

    outputs = list(run(gen, at_tick))
    assert ended(outputs) == [("0", 3), ("1", int(Termination.COMPLETED))]
    assert np.ptp([output.q for output in outputs[100:295]], axis=0).max() == 0.0
    assert outputs[-1].q == pytest.approx([-1.5, -0.4])


@pytest.mark.parametrize("skipped_after", range(29, 33))  # the samples round that in which the rate becomes 0
def test_a_skip_of_a_line_as_a_pause_begins_turns_into_the_next_one_in_whichever_sample(skipped_after: int) -> None:
    gen = puma_generator()
    for k, place in enumerate(((0.1, 0.05, 0.05), (-0.1, 0.1, 0.0))):
        gen.push(MoveRequest(f"{k}", at_park(shift(*place)).goal(), SpeedShare(0.15), mode=MotionMode.CARTESIAN))
    for tick in range(1, 14 + skipped_after):
        gen.override = float(tick < 12)
        if tick == 12 + skipped_after:
            gen.skip(3)
        output = gen.update(tick)
    assert gen.rate < 0.01
    assert output.request is not None
    assert (output.request.name, gen.phase) == ("1", Phase.MOVING)


@pytest.mark.parametrize("begin", [2, 3])
def test_a_pause_aborts_no_line_that_the_arm_can_just_follow(begin: int) -> None:
    gen = puma_generator()
    for name, place, transition_s in (
        ("0", (-0.00434, -0.26151, -0.24653, -1.4057), 0.2),
        ("1", (-0.00533, 0.23501, 0.02657, 1.08245), None),
    ):
        goal = at_park(shift(*place)).goal()
        gen.push(MoveRequest(name, goal, SpeedShare(1.0), transition_s, mode=MotionMode.CARTESIAN))

    def at_tick(tick: int) -> None:
        gen.override = float(not begin <= tick < 72)

    assert [code for _, code in ended(list(run(gen, at_tick)))] == 2 * [int(Termination.COMPLETED)]


def test_a_belt_is_left_when_the_pause_is_over_and_followed_until_then() -> None:
    gen, belt = puma_generator(), Conveyor(lambda t: (0.05 * t, 0.0, 0.0, 0.0))
    gen.push(MoveRequest("belt", at_park(belt.trsf).goal(), SpeedShare(0.3), mode=MotionMode.CARTESIAN))
    away, begun = MoveRequest("away", PARK + 0.1, SpeedShare(0.3)), {}
    path = [PARK, PARK]
    for tick in range(1, 260):
        belt.tick = tick
        if tick == 90:  # it follows
            gen.override = 0.0
            gen.push(away)
        if tick == 130:
            gen.override = 0.4
        output = gen.update(tick)
        path.append(output.q)
        for event in output.events:
            begun.setdefault((event.request.name if event.request else "", event.kind.name), tick)
        if tick in (89, 129):
            assert gen.state()[1].any()
    assert begun["away", "BEGUN"] == 130
    assert gen.rate == 0.4
    steps = np.abs(np.diff(path, n=2, axis=0)) / PERIOD_S**2
    assert (steps <= ARM_LIMITS.a_max).all()
    assert path[-1] == pytest.approx(PARK + 0.1)


@pytest.mark.parametrize("seconds", [0.0, 1.5])
def test_a_path_stop_takes_over_the_acceleration_of_a_change_of_speed(seconds: float) -> None:
    for at in range(12, 46, 3):
        gen, path = generator(), [np.zeros(2)]
        joint_program(gen, [(2.5, 0.4, None)])
        for tick in range(1, 160):
            gen.override = 0.05 if 10 <= tick < 30 else 0.9
            if tick == at:
                before = gen.state(), gen.rate
                gen.stop(seconds)
                assert gen.state() == pytest.approx(before[0], abs=ROUNDING)
                assert gen.rate == pytest.approx(before[1])
            gen.update(tick)
            assert -ROUNDING <= gen.rate <= 1.0 + ROUNDING
            assert LIMITS.allow(gen.state())
            path.append(gen.state()[0])
        assert (np.diff(path, axis=0) >= -ROUNDING).all()  # never back
        assert (gen.rate, gen.phase) == (0.9, Phase.RESTING)


@pytest.mark.parametrize("factor", [0.0, 0.25])
def test_what_waits_for_the_end_of_a_joint_stop_begins_at_the_override_and_not_at_all_in_a_pause(factor: float) -> None:
    gen = generator()
    gen.push(MoveRequest("cut", np.array([2.5, 0.4]), SpeedShare(1.0)))
    rates = []
    for tick in range(1, 100):
        if tick == 15:
            gen.abort(7)
        if tick == 16:
            gen.override = factor
            gen.push(MoveRequest("next", np.array([-1.5, -0.4]), SpeedShare(1.0)))
        output = gen.update(tick)
        if tick > 15 and gen.phase is not Phase.JOINT_STOP:
            rates.append((gen.rate, tuple(output.q)))
    assert {rate for rate, _ in rates} == {factor}
    assert (len({q for _, q in rates}) == 1) == (factor == 0.0)


def mixed_program(gen: Generator, random: Random) -> None:
    """To joint positions, along a straight line and back again."""
    gen.push(MoveRequest("joints", PARK + 0.3 * random.random(), SpeedShare(random.uniform(0.2, 0.8)), 0.1))
    x, y, z, turn = (random.uniform(-0.1, 0.1) for _ in range(4))
    place = at_park(shift(x, y, z, turn)).goal()
    gen.push(MoveRequest("line", place, SpeedShare(random.uniform(0.2, 0.5)), mode=MotionMode.CARTESIAN))
    gen.push(MoveRequest("back", PARK, SpeedShare(random.uniform(0.2, 0.5)), 0.1))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", [0, 1, 12, 68, 108, 110, 119, 128])  # all but two were a sample late once
def test_after_a_pause_the_path_turns_round_every_via_point_where_it_would_have(seed: int) -> None:
    """Path time is whole but for rounding when the speed is full again: no transition may begin a sample late."""
    random, gen = Random(seed), puma_generator()
    mixed_program(gen, random)
    begin, end = random.randint(2, 20), random.randint(21, 120)
    plan = gen.plan()
    nominal = plan.table(np.linspace(0.0, plan.duration_s, 10_000))[:, 0]
    coarseness = np.abs(np.diff(nominal, axis=0)).max()

    def at_tick(tick: int) -> None:
        gen.override = 0.0 if begin <= tick < end else 1.0

    for output in run(gen, at_tick):
        assert np.abs(nominal - output.q).max(axis=1).min() <= coarseness


class Operator:
    """Someone who pushes motions, skips, stops and changes the speed of a PUMA whenever a seed says so."""

    def __init__(self, seed: int, gen: Generator) -> None:
        random = Random(seed)
        self._gen, self.pushed = gen, 0
        self._requests = {random.randint(1, 140): self._request(random, str(k)) for k in range(random.randint(1, 5))}
        speeds = (0.0, 1.0, 0.05, random.random())
        self._speeds = {random.randint(1, 300): random.choice(speeds) for _ in range(6)} | {400: 1.0}
        ways: list[Callable[[], None]] = [gen.stop, lambda: gen.stop(0.5), lambda: gen.abort(5), lambda: gen.skip(3)]
        self._cuts = {random.randint(2, 300): random.choice(ways) for _ in range(random.randint(0, 3))}

    def act(self, tick: int) -> None:
        """Do what is due at a sample; motions that the arm cannot do are refused."""
        if tick in self._requests:
            with suppress(MotionError):
                self._gen.push(self._requests[tick])
                self.pushed += 1
        if tick in self._speeds:
            self._gen.override = self._speeds[tick]
        if tick in self._cuts:
            self._cuts[tick]()

    def _request(self, random: Random, name: str) -> MoveRequest:
        transition_s, speed = random.choice((None, 0.1, 0.3, 0.9)), SpeedShare(random.uniform(0.2, 1.0))
        if random.random() < 0.5:
            return MoveRequest(name, PARK + [random.uniform(-0.5, 0.5) for _ in PARK], speed, transition_s)
        x, y, z, turn = (random.uniform(-most, most) for most in (0.15, 0.15, 0.12, 0.5))
        goal = at_park(shift(x, y, z, turn)).goal()
        return MoveRequest(name, goal, speed, transition_s, mode=random.choice(list(MotionMode)))


@pytest.mark.sampled(16)
@pytest.mark.parametrize("seed", range(40))
def test_whatever_an_operator_does_and_when_the_limits_are_kept_and_every_motion_ends(seed: int) -> None:
    gen = puma_generator()
    operator, path, told = Operator(seed, gen), [PARK, PARK], []
    for tick in range(1, 2000):
        operator.act(tick)
        output = gen.update(tick)
        path.append(output.q)
        told.append(output)
        if tick > 400 and not output.moving:
            break
    assert len(ended(told)) == operator.pushed
    v = np.diff(np.array(path), axis=0) / PERIOD_S
    assert (np.abs(v) <= ARM_LIMITS.v_max * (1.0 + ROUNDING)).all()
    assert (np.abs(np.diff(v, axis=0)) <= ARM_LIMITS.a_max * PERIOD_S * (1.0 + ROUNDING)).all()


@given(CHANGES, st.integers(1, 3))
@settings(max_examples=examples(150), deadline=None)
def test_the_rate_stays_between_0_and_1_and_is_the_slope_of_path_time(changes, left_out) -> None:
    override, wanted, at = SpeedOverride(LIMITS, PERIOD_S), 1.0, {}
    tick = 0
    for after, factor in changes:
        tick += after
        at[tick] = factor
    most = SHARE * float((LIMITS.a_stop / LIMITS.v_max).min()) * PERIOD_S
    for now in range(0, 400, left_out):
        for k in range(now, now + left_out):
            wanted = at.get(k, wanted)
        before = override.rate
        passed = override.advance(left_out, wanted)
        assert -ROUNDING <= override.rate <= 1.0 + ROUNDING
        slowest, fastest = min(before, override.rate), max(before, override.rate)
        assert (slowest - 0.1) * left_out <= passed <= (fastest + 0.1) * left_out
        assert abs(override.rate - before) <= 2.0 * most * left_out
    for _ in range(100):
        override.advance(1, wanted)
    assert override.rate == wanted


@pytest.mark.parametrize("factor", [-0.1, 1.1, float("nan"), float("inf")])
def test_an_override_that_is_none_is_refused(factor: float) -> None:
    gen = generator()
    with pytest.raises(MotionError, match="0 to 1 are possible"):
        gen.override = factor
    assert gen.override == 1.0
    assert gen.phase is Phase.RESTING
    gen.push(MoveRequest("there", np.array([0.5, 0.1]), JointSpeed(0.5)))
    assert gen.update(1).moving
