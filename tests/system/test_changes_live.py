"""A running arm, inside fences, whose speed, load and motion are changed at random: judged by its own log.

    operator   override, pause and resume; a stop or an emergency stop that keeps the path, and the word to go on
    program    another payload, a motion into a fence that is refused

Each comes so many samples after the one before, so that a slow machine meets the same run as a quick one. Not judged
is what a setpoint that came late has bent: the servo goes straight on then, which its log tells; nor a run whose stream
was lost, as long as somebody else saw that this machine kept processes from running.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from random import Random
from typing import Any, NamedTuple

import numpy as np
import pytest

from qrobot import rccl
from qrobot.errors import FenceCrossed
from qrobot.faultcodes import FaultCode
from qrobot.fences.fence_set import FenceSet, fences_of
from qrobot.fences.in_force import use_fences
from qrobot.hwif.board_memory import attach_board_memory
from qrobot.log.read import read_log
from qrobot.modecodes import Mode
from qrobot.motion.kept import WAY_BACK_SHARE
from qrobot.servo.memory.telemetry import Rows
from qrobot.servo.operator.client import ServoClient
from tests.support.missed_frames import in_time
from tests.support.patience import wait_until
from tests.support.processes import UNHURRIED_MS, RunningArm, events_of, running_arms
from tests.support.puma import LIMITS, PARK, ROBOT
from tests.support.puma import arm as puma
from tests.support.shared_arm import return_to_start, settle
from tests.support.stall_watch import ANY_TIME_S, StreamLostError, unless_stalled

pytestmark = pytest.mark.realtime

BENCH = """
[arm.fences]
self_collision = true

[[arm.fences.shape]]
name = "bench"
shape = "box"
size_m = [0.6, 1.2, 0.1]
position_m = [0.6, 0.0, -0.265]
"""
TURNS = ([40.0, -10, 5, 0, 0, 0], [20.0, 15, -10, 20, 0, 0], [-25.0, 10, -10, 20, 30, 0])  # from park, degrees
DOWN = [0.0, 35, 0, 0, 0, 0]  # into the bench
ACTS = {"override": 5, "pause": 2, "payload": 2, "stop": 2, "emergency": 1, "refusal": 1}
TURN_MS, LEG_MS = 350, 1100  # half a turn, and a leg
FIRST, LAST = 1, 4  # samples between two of them
MODES = {
    "stop": (Mode.STOPPING, Mode.HOLDING, Mode.TRACKING),
    "emergency": (Mode.FAULT, Mode.OFF, Mode.POWERING, Mode.HOLDING, Mode.TRACKING),
}
OFF_RAD = 5e-4  # [A] interpolation between samples of 100 ms leaves the turns of this path by 0.13 mrad
NEAR_M = 0.06
SEED = 2
EACH = 10  # cycles between two places that are looked at
ROUNDING = 1e-9


class Run(NamedTuple):
    """What a disturbed run leaves.

    Attributes:
        rows: of its log, from the first motion until the last one had ended.
        judged: those that no late setpoint has bent. Shape (rows,).
        off: how far the setpoint of every tenth row is from the path that was planned, rad; 0 where it is not judged.
            Shape (rows / EACH,).
        acts, overrides, payloads: that were asked for, in this order; shares, and kg.
        fences: that the arm was inside.
    """

    rows: Rows
    judged: np.ndarray[Any, Any]
    off: np.ndarray[Any, Any]
    acts: list[str]
    overrides: list[float]
    payloads: list[float]
    fences: FenceSet


def push_lap(arm: rccl.Channel) -> None:
    """Three places as joints go, and straight back to park; each is rounded."""
    park = rccl.newtrans("PARK", "const")
    park.set(puma().forward(PARK))
    arm.setmode("joint")
    for turn in TURNS:
        arm.setime(TURN_MS, LEG_MS)
        arm.move(arm.jposition("via", (np.degrees(PARK) + turn).tolist()))
    arm.setmode("cartesian")
    arm.setime(TURN_MS, LEG_MS)
    arm.move(rccl.makeposition("back", rccl.t6, rccl.EQ, park, rccl.TL, park))


class Disturber:
    """Does to a moving arm what is asked for, and waits until it is in force."""

    def __init__(self, arm: rccl.Channel, servo: ServoClient, random: Random) -> None:
        self._arm, self._servo, self._random = arm, servo, random
        self.overrides, self.payloads = list[float](), list[float]()

    def do(self, act: str) -> None:
        """One of `ACTS`, some samples from now; motions never run out before."""
        if self._arm.unserved <= len(TURNS) + 1:
            push_lap(self._arm)
        until = self._arm.time + UNHURRIED_MS * self._random.randint(FIRST, LAST)
        self._arm.waitas(lambda: self._arm.time >= until)
        getattr(self, act)()

    def wait(self, condition: Callable[[], bool], what: str) -> None:
        """Wait until something is so. Raises StreamLostError when the servo has told so meanwhile."""

        def met() -> bool:
            if self._arm.how.event == FaultCode.STREAM_LOST:
                raise StreamLostError
            return condition()

        wait_until(met, what)

    def override(self, factor: float | None = None) -> None:
        """Another speed for the motion under way."""
        self.overrides.append(self._random.uniform(0.4, 0.95) if factor is None else factor)
        self._servo.change_override(self.overrides[-1])

    def pause(self) -> None:
        """Stand still on the path, and go on."""
        self._servo.pause()
        self.wait(lambda: self._arm.rate == 0.0, "the arm stands on its path")
        self._servo.resume()

    def payload(self) -> None:
        """Another load, that the servo reckons with."""
        self.payloads.append(self._random.uniform(0.5, 2.5))
        self._arm.setload(self.payloads[-1])

    def stop(self) -> None:
        """A controlled stop of the servo, whose path is kept, and the operator's word to go on."""
        self._servo.stop()
        self._confirm()

    def emergency(self) -> None:
        """The emergency stop, in which the arm sags off its path until its brakes hold it."""
        with attach_board_memory(self._servo.arm) as board:
            board.memory.panel.estop = 1
            try:
                self.wait(lambda: self._arm.how.mode == Mode.FAULT, "the servo has seen it")
            finally:
                board.memory.panel.estop = 0
        self._confirm()

    def _confirm(self) -> None:
        self.wait(lambda: self._arm.kept, "the path is kept")
        self._servo.resume()
        self.wait(lambda: not self._arm.kept, "the arm goes back to its path")

    def refusal(self) -> None:
        """A motion into a fence."""
        with pytest.raises(FenceCrossed, match="bench"):
            self._arm.move(self._arm.jposition("down", (np.degrees(PARK) + DOWN).tolist()))


def undisturbed_stream(running: RunningArm) -> Run:
    """A run whose stream was not lost: made again when it was, if this machine kept processes from running."""

    def begin_anew() -> None:
        settle(running)
        return_to_start(running)

    return unless_stalled(lambda: disturbed_run(running, Random(SEED)), begin_anew)


def disturbed_run(running: RunningArm, random: Random) -> Run:
    """Laps of the path with every act, in random order, at random instants. Raises StreamLostError."""
    acts = [act for act, times in ACTS.items() for _ in range(times)]
    random.shuffle(acts)
    fences = fences_of(running.arm, ROBOT)
    assert fences is not None
    with use_fences(fences), running.control() as arm, ServoClient(running.name) as servo:
        arm.keep_path()
        begin_ns = running.snapshot().t_ns
        push_lap(arm)
        push_lap(arm)
        plan = arm.plan()
        disturber = Disturber(arm, servo, random)
        for act in acts:
            disturber.do(act)
        disturber.override(1.0)
        disturber.wait(lambda: not arm.unserved, "the motions end")
        running.wait_for_rest()
        end_ns = running.snapshot().t_ns
    path = plan.table(np.linspace(0.0, plan.duration_s, 6_000))[:, 0]
    rows = logged(running, end_ns)
    rows = rows[(rows["t_ns"] >= begin_ns) & (rows["t_ns"] <= end_ns)]
    if FaultCode.STREAM_LOST in events_of(rows):  # in a stop that was asked for
        raise StreamLostError("as the log tells", ANY_TIME_S)
    whole = np.vstack([rows["q_ref"][:1], path])  # a plan begins where the arm is on its way already
    judged = in_time(rows)
    away = np.where(judged[::EACH], off(rows["q_ref"][::EACH], whole), 0.0)
    return Run(rows, judged, away, acts, disturber.overrides, disturber.payloads, fences)


def logged(running: RunningArm, until_ns: int) -> Rows:
    """Rows of the arm's log, once it has come so far."""
    rows: list[Rows] = []

    def there() -> bool:
        rows[:] = [read_log(running.newest_log()).rows]
        return bool(rows[0].size and rows[0]["t_ns"][-1] >= until_ns)

    wait_until(there, "the log is written")
    return rows[0]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    """One arm, and one run of it for every check."""
    with running_arms(tmp_path_factory.mktemp("changes"), more=BENCH) as (arm,):
        yield undisturbed_stream(arm)


def off(q: np.ndarray[Any, Any], path: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Greatest distance of a joint at each of `q` (k, 6) from the nearest place of a polyline, rad. Shape (k,)."""
    starts, ways = path[:-1], np.diff(path, axis=0)
    squares = np.maximum((ways * ways).sum(axis=1), 1e-30)
    found = np.empty(len(q))
    for k, place in enumerate(q):
        near = np.argmin(((path - place) ** 2).sum(axis=1))
        segments = np.clip([near - 1, near], 0, len(starts) - 1)
        share = np.clip(((place - starts[segments]) * ways[segments]).sum(axis=1) / squares[segments], 0.0, 1.0)
        found[k] = np.abs(starts[segments] + share[:, None] * ways[segments] - place).max(axis=1).min()
    return found


def spans(rows: Rows) -> list[tuple[Mode, slice]]:
    """Rows between changes of the mode."""
    cuts = [0, *(np.flatnonzero(np.diff(rows["mode"])) + 1).tolist(), rows.size]
    return [(Mode(int(rows["mode"][begin])), slice(begin, end)) for begin, end in pairwise(cuts)]


def ways_back(run: Run) -> list[tuple[slice, np.ndarray[Any, Any]]]:
    """Rows from each confirmation until the arm is on its path, and how far off it is from there to the next stop."""
    found = []
    for (before, _), (mode, span) in pairwise(spans(run.rows)):
        if (before, mode) == (Mode.HOLDING, Mode.TRACKING):
            begin, end = -(-span.start // EACH), -(-span.stop // EACH)
            away = np.flatnonzero(run.off[begin:end] > OFF_RAD)
            there = begin + (int(away[-1]) + 1 if away.size else 0)
            found.append((slice(span.start, max(span.start, EACH * (there - 1))), run.off[there:end]))
    return found


def test_the_log_tells_what_was_asked_for_in_turn_and_nothing_else(run: Run) -> None:
    assert np.unique(run.rows["fault"]).tolist() == [0, FaultCode.ESTOP]
    assert np.unique(np.diff(run.rows["tick"])).tolist() == [1]
    modes = [Mode.TRACKING, *(mode for act in run.acts for mode in MODES.get(act, ()))]
    assert [mode for mode, _ in spans(run.rows)] == modes
    told = run.rows["override"]
    assert told[np.r_[True, np.diff(told) != 0.0]].tolist() == [1.0, *run.overrides]
    mass = run.rows["payload"][:, 0]
    held = mass[np.r_[False, np.diff(mass) == 0.0]]
    assert held[np.r_[True, np.diff(held) != 0.0]] == pytest.approx([mass[0], *run.payloads], abs=1e-9)


def test_the_arm_goes_through_the_places_of_its_plan_whatever_its_speed(run: Run) -> None:
    (_, first), *others = spans(run.rows)
    assert run.off[: first.stop // EACH].max() < OFF_RAD
    for _, on_path in ways_back(run):
        assert on_path.max(initial=0.0) < OFF_RAD
    assert ways_back(run)[-1][1].size  # the last stop of all ends on the path
    for mode, span in others:
        if mode is Mode.HOLDING:
            assert np.ptp(run.rows["q_ref"][span], axis=0).max() < ROUNDING
    assert run.rows["q_ref"][-1] == pytest.approx(PARK, abs=OFF_RAD)


def test_the_way_back_is_straight_and_slow(run: Run) -> None:
    ways = [run.rows[way][run.judged[way]] for way, _ in ways_back(run)]
    assert len(ways) == ACTS["stop"] + ACTS["emergency"]
    assert any(way.size for way in ways)  # of the arm that has sagged
    for way in filter(len, ways):
        assert off(way["q_ref"][::EACH], way["q_ref"][[0, -1]]).max() < OFF_RAD
        assert (np.abs(way["v_ref"]) <= WAY_BACK_SHARE * LIMITS.v_max * (1.0 + ROUNDING)).all()


def test_pauses_hold_the_arm_on_its_path(run: Run) -> None:
    tracking = run.rows[run.rows["mode"] == Mode.TRACKING]
    still = ~tracking["v_ref"].any(axis=1)
    places = {tuple(place) for place in np.round(tracking["q_ref"][still], 4)}
    assert len(places) >= ACTS["pause"]


def test_setpoints_do_not_jump_and_keep_the_limits_of_the_joints(run: Run) -> None:
    rows = run.rows
    led = run.judged & np.isin(rows["mode"], (Mode.TRACKING, Mode.STOPPING, Mode.HOLDING))
    assert led.mean() > 0.5
    both, seconds = led[1:] & led[:-1], np.diff(rows["t_ns"])[:, None] * 1e-9
    faster, way = np.diff(rows["v_ref"], axis=0), 0.5 * seconds * (rows["v_ref"][1:] + rows["v_ref"][:-1])
    jump = np.diff(rows["q_ref"], axis=0) - way
    assert (np.abs(rows["v_ref"][led]) <= LIMITS.v_max).all()
    assert (np.abs(rows["a_ref"][led]) <= LIMITS.a_max).all()
    assert (np.abs(faster) <= LIMITS.a_max * seconds)[both].all()
    assert (np.abs(jump) <= LIMITS.a_max * seconds**2)[both].all()


def test_the_arm_passes_near_the_bench_and_keeps_off(run: Run) -> None:
    nearest = min(run.fences.distances(q)[0] for q in run.rows["q"][:: 5 * EACH])
    assert run.fences.margins[0] < nearest < NEAR_M
