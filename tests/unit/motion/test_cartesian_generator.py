"""Goals of equations: times, codes, refusals, and what stops an arm before it passes a limit."""

from __future__ import annotations

import re

import numpy as np
import pytest

from qrobot.errors import JointLimit, MotionError, Singular, Unreachable
from qrobot.model.branch import branch_of
from qrobot.model.transform import transform
from qrobot.motion import (
    HERE,
    T6,
    Duration,
    Equation,
    EventKind,
    MotionMode,
    MoveRequest,
    SpeedShare,
    Termination,
    ToolSpeed,
    TransformKind,
    Trsf,
)
from tests.support.motion import ended, generator, run
from tests.support.puma import LIMITS, PARK, PERIOD_S, Conveyor, arm, at_park, puma_generator, shift

SLOW = ToolSpeed(0.2, 1.0)
DONE = Termination.COMPLETED
RUN = branch_of("run")


def to(equation: Equation, mode: MotionMode = MotionMode.CARTESIAN, speed=SLOW, **more) -> MoveRequest:
    return MoveRequest(equation.name, equation.goal(), speed, mode=mode, **more)


def served(output, name: str) -> bool:
    return output.request is not None and output.request.name == name


def run_on(gen, belt: Conveyor, ticks: int, at_tick=lambda _: None) -> list:
    """Outputs of `ticks` samples with a frame that moves, whether the arm is idle or not."""
    outputs = []
    for tick in range(1, ticks + 1):
        belt.tick = tick
        at_tick(tick)
        outputs.append(gen.update(tick))
    return outputs


def lost(outputs) -> list[int]:
    return [event.code for output in outputs for event in output.events if event.kind is EventKind.LOST]


def assert_stopped_within_limits(outputs) -> None:
    path = np.array([PARK, *(output.q for output in outputs)])
    assert (LIMITS.q_min <= path).all()
    assert (path <= LIMITS.q_max).all()
    v = np.diff(path, axis=0) / PERIOD_S
    assert (np.abs(v) <= 1.06 * LIMITS.v_max).all()
    assert (np.abs(np.diff(v, axis=0)) / PERIOD_S <= 1.06 * LIMITS.a_max).all()
    assert (path[-1] == path[-2]).all()


# --------------------------------------------------------------------------------------------------- times and speeds


@pytest.mark.parametrize("mode", list(MotionMode))
@pytest.mark.parametrize(
    ("there", "seconds"), [(shift(y=0.2), 1.0), (shift(turn=0.5), 0.5), (shift(y=0.1, turn=0.8), 0.8)]
)
def test_with_velocities_the_distance_of_the_tool_frame_sets_the_time(mode, there, seconds) -> None:
    """A-18: distance over translational, turn over rotational velocity, whichever is longer."""
    gen = puma_generator()
    gen.push(to(at_park(there), mode, transition_s=0.14))
    outputs = list(run(gen))
    assert len(outputs) - 1 == pytest.approx(np.ceil(seconds / PERIOD_S) + 2 * 5, abs=1)


def test_a_given_time_is_kept() -> None:
    gen = puma_generator()
    gen.push(to(at_park(shift(y=0.1)), speed=Duration(1.4), transition_s=0.28))
    assert len(list(run(gen))) == 1 + 50 + 2 * 10


def test_a_transition_rounds_the_corner_in_cartesian_mode() -> None:
    gen = puma_generator()
    for where in (shift(y=0.1), shift(y=0.1, z=-0.1)):
        gen.push(to(at_park(where)))
    path = np.array([arm().forward(output.q)[:3, 3] for output in run(gen)])
    speed = np.linalg.norm(np.diff(path, axis=0), axis=1) / PERIOD_S
    assert speed[10:-12].min() > 0.1
    assert speed.max() == pytest.approx(0.2, rel=0.01)


def test_a_configuration_is_changed_in_joint_mode_alone() -> None:
    flip = branch_of("ruf")
    gen = puma_generator()
    assert arm().branch(PARK).letters == "lun"
    with pytest.raises(MotionError, match="move to P: no straight line changes configuration from 'lun' to 'ruf'"):
        gen.push(to(at_park(shift(y=0.1)), branch=flip))
    gen.push(to(at_park(shift(y=0.1)), MotionMode.JOINT, speed=SpeedShare(0.5), branch=flip))
    gen.push(to(at_park(shift(y=0.15))))
    outputs = list(run(gen))
    assert [code for _, code in ended(outputs)] == [DONE, DONE]
    assert arm().branch(outputs[-1].q) == flip


# -------------------------------------------------------------------------------------------------- moving goals


def test_at_the_end_of_the_queue_the_arm_rests_relative_to_the_last_frame() -> None:
    """A-22: not in absolute coordinates; and `there` brings it to rest in these."""
    belt = Conveyor(lambda t: (0.05 * np.sin(2 * t), 0.0, 0.0, 0.0))
    gen = puma_generator()
    gen.push(to(at_park(belt.trsf)))
    stop = MoveRequest("there", HERE, SpeedShare(0.5))
    outputs = run_on(gen, belt, 200, lambda tick: gen.push(stop) if tick == 150 else None)
    moves = np.abs(np.diff([output.q for output in outputs], axis=0)).max(axis=1)
    assert not outputs[140].moving
    assert moves[100:149].max() > 1e-3
    assert moves[175:].max() == 0.0
    assert ended(outputs) == [("P", DONE), ("there", DONE)]


def test_a_stop_by_name_is_absolute_while_a_frame_is_followed() -> None:
    belt = Conveyor(lambda t: (0.05 * np.sin(2 * t), 0.0, 0.0, 0.0))
    gen = puma_generator()
    gen.push(to(at_park(belt.trsf)))
    outputs = run_on(gen, belt, 160, lambda tick: gen.stop() if tick == 120 else None)
    assert_stopped_within_limits(outputs)


def test_a_repeated_move_to_a_moving_position_stands_still_relative_to_it() -> None:
    """A-32."""
    belt = Conveyor(lambda t: (0.0, 0.02 * t, 0.0, 0.0))
    equation = at_park(belt.trsf)
    gen = puma_generator()
    gen.push(to(equation))
    gen.push(to(equation, speed=Duration(0.4)))
    outputs = run_on(gen, belt, 80)
    assert ended(outputs) == [("P", DONE), ("P", DONE)]
    for tick in range(60, 80):
        here = arm().forward(PARK) @ transform(translation=[0.0, 0.02 * (tick + 1) * PERIOD_S, 0.0])
        assert arm().forward(outputs[tick].q) == pytest.approx(here, abs=1e-9)


def test_in_joint_mode_a_goal_of_constant_joint_speed_is_met_by_linear_extrapolation() -> None:
    """A-29: the joints move on the straight line to where the goal will be."""
    rate = np.array([0.05, -0.02, 0.03, 0.0, 0.02, 0.04])
    offset = np.array([0.2, -0.1, 0.1, 0.1, 0.1, 0.2])
    tick_now = 0

    def follow(trsf: Trsf) -> None:
        trsf.value = arm().forward(PARK + offset + rate * tick_now * PERIOD_S)

    equation = Equation("P", [T6], [Trsf("G", TransformKind.FUNCTION, function=follow)], T6)
    gen = puma_generator()
    gen.push(to(equation, MotionMode.JOINT, speed=Duration(1.4), transition_s=0.28))
    path = []
    for tick_now in range(1, 80):
        path.append(gen.update(tick_now).q)
    straight = np.array(path[25:50])
    assert np.abs(np.diff(straight, 2, axis=0)).max() < 1e-9
    assert path[-1] == pytest.approx(PARK + offset + rate * 79 * PERIOD_S, abs=1e-9)


def test_a_variable_transform_acts_at_once_and_a_hold_not_at_all() -> None:
    varb, hold = Trsf("V"), Trsf("H", TransformKind.HOLD)
    gen = puma_generator()
    gen.push(to(at_park(varb, hold)))
    held = [gen.update(tick).q for tick in range(1, 60)][-1]
    hold.set(transform(translation=[0.1, 0.0, 0.0]))
    assert gen.update(60).q == pytest.approx(held)
    varb.set(transform(translation=[0.0, 0.001, 0.0]))
    assert np.linalg.norm(arm().forward(gen.update(61).q)[:3, 3] - arm().forward(held)[:3, 3]) == pytest.approx(0.001)


# ------------------------------------------------------------------------------------------------ monitors and codes


def test_a_monitor_ends_its_request_with_the_code_it_picks() -> None:
    seen: list[int] = []

    def monitor() -> int:
        seen.append(1)
        return 33 if len(seen) == 20 else 0

    gen = puma_generator()
    gen.push(to(at_park(shift(y=0.2)), monitor=monitor))
    gen.push(to(at_park()))
    assert ended(list(run(gen))) == [("P", 33), ("P", DONE)]
    assert len(seen) == 20


def test_what_a_monitor_raises_reaches_whoever_runs_the_generator() -> None:
    gen = puma_generator()
    gen.push(to(at_park(shift(y=0.2)), monitor=lambda: 1 // 0))
    with pytest.raises(ZeroDivisionError):
        list(run(gen))


@pytest.mark.parametrize("mode", list(MotionMode))
def test_a_goal_that_moves_out_of_reach_ends_in_an_absolute_stop_before_a_limit_is_passed(mode) -> None:
    belt = Conveyor(lambda t: (0.2 * t, 0.0, 0.0, 0.0))
    gen = puma_generator()
    gen.push(to(at_park(belt.trsf), mode))
    outputs = run_on(gen, belt, 250)
    assert lost(outputs)[0] in (Termination.UNREACHABLE, Termination.SINGULAR, Termination.JOINT_LIMIT)
    assert_stopped_within_limits(outputs)


def test_a_goal_that_turns_a_joint_to_its_limit_is_left_before_it() -> None:
    belt = Conveyor(lambda t: (0.0, 0.0, 0.0, -1.0 * t))
    gen = puma_generator()
    gen.push(to(at_park(belt.trsf), MotionMode.JOINT))
    outputs = run_on(gen, belt, 400)
    assert lost(outputs) == [Termination.JOINT_LIMIT]
    (why,) = (event.why for output in outputs for event in output.events if event.kind is EventKind.LOST)
    room = np.minimum(outputs[-1].q - LIMITS.q_min, LIMITS.q_max - outputs[-1].q)
    nearest = int(room.argmin())
    named = re.fullmatch(
        r"joint (\d) \(\w+\) at (-?[\d.]+) deg could not stop within its range, (\S+) deg to (\S+) deg", why
    )
    assert named is not None, why
    assert int(named[1]) == nearest + 1
    told = np.array([float(named[k]) for k in (2, 3, 4)])
    assert told[1:] == pytest.approx(np.degrees([LIMITS.q_min[nearest], LIMITS.q_max[nearest]]), abs=0.01)
    assert np.abs(told[1:] - told[0]).min() < 15.0
    assert_stopped_within_limits(outputs)


@pytest.mark.parametrize("transition_s", [0.2, 0.5, 0.8])
@pytest.mark.parametrize("room", [0.03, 0.06, 0.12, 0.25, 0.5])
def test_a_goal_that_turns_a_joint_towards_its_limit_is_left_inside_the_range(room: float, transition_s: float) -> None:
    """For joint positions: what the joints turn with already fades out, and has to have the room for that."""
    belt, gen, asked = Conveyor(lambda t: (0.0, 0.0, 0.0, -1.0 * t)), puma_generator(), False
    gen.push(to(at_park(belt.trsf), MotionMode.JOINT))
    outputs = []
    for tick in range(1, 500):
        belt.tick = tick
        outputs.append(gen.update(tick))
        q = outputs[-1].q
        if not asked and np.minimum(q - LIMITS.q_min, LIMITS.q_max - q).min() < room:
            gen.push(MoveRequest("home", PARK, SpeedShare(0.3), transition_s=transition_s))
            asked = True
    assert asked
    assert_stopped_within_limits(outputs)
    assert outputs[-1].q == pytest.approx(PARK) or lost(outputs)


@pytest.mark.parametrize("seconds", [0.5, 60.0])
@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_a_line_on_which_a_joint_comes_to_the_end_of_its_range_is_refused_whatever_its_time(way, seconds) -> None:
    """At the goal the flange has another solution, a whole turn away: no way leads there in a straight line."""
    start = np.array(PARK)
    start[5] = LIMITS.q_max[5] - 0.2 if way > 0 else LIMITS.q_min[5] + 0.2
    gen = puma_generator(start)
    stands = Trsf("STANDS", TransformKind.CONST, arm().forward(start))
    goal = Equation("ROUND", (T6,), (stands, shift(turn=0.5 * way)), T6)
    with pytest.raises(JointLimit, match=r"move to ROUND: joint 6 \(flange\) at \S+ deg would leave its range"):
        gen.push(to(goal, speed=Duration(seconds)))
    assert not gen.busy
    gen.push(to(Equation("BACK", (T6,), (stands, shift(turn=-0.5 * way)), T6)))
    assert ended(list(run(gen)))[-1][1] == DONE


@pytest.mark.parametrize("pushed_at", [1, 40])
@pytest.mark.parametrize(
    ("mode", "flange_deg", "seconds"),
    [
        (MotionMode.JOINT, 155.0, 0.6),
        (MotionMode.CARTESIAN, 200.0, 1.0),
        (MotionMode.CARTESIAN, 100.0, 1.0),
        (MotionMode.CARTESIAN, 90.0, 1.0),
    ],
)
def test_what_follows_a_line_begins_with_the_joints_to_which_that_leads(pushed_at, mode, flange_deg, seconds) -> None:
    """On the line joint 6 turns from -45 to 150 degrees: -210, which are the same place, are nearer to its begin."""

    def turned(waist_deg: float, deg: float) -> np.ndarray:
        return PARK + np.radians([waist_deg, 0.0, 0.0, 0.0, 0.0, deg])

    def line(name: str, q: np.ndarray, seconds: float) -> MoveRequest:
        place = Trsf("PLACE", TransformKind.CONST, arm().forward(q))
        return to(Equation(name, (T6,), (place,), T6), speed=Duration(seconds))

    gen, last = puma_generator(turned(-22.5, -45.0)), turned(22.5, flange_deg)
    gen.push(line("first", turned(22.5, 150.0), 3.0))
    joints = MoveRequest("last", last, Duration(seconds))
    behind = joints if mode is MotionMode.JOINT else line("last", last, seconds)
    outputs = list(run(gen, lambda tick: gen.push(behind) if tick == pushed_at else None))
    assert ended(outputs) == [("first", DONE), ("last", DONE)]
    assert outputs[-1].q == pytest.approx(last, abs=1e-9)
    transitions = 0.4 if mode is MotionMode.CARTESIAN else 0.2 + seconds / 7
    assert len(outputs) * PERIOD_S == pytest.approx(3.0 + seconds + transitions, abs=0.1)


def test_a_frame_that_jumps_during_a_segment_ends_it_with_too_fast_and_drops_what_waits() -> None:
    belt = Conveyor(lambda t: (0.0, 0.0 if t < 1.0 else 0.1, 0.0, 0.0))
    gen = puma_generator()
    gen.push(to(at_park(belt.trsf, shift(z=-0.2))))
    gen.push(to(at_park()))
    outputs = run_on(gen, belt, 100)
    assert ended(outputs) == [("P", Termination.STOPPED), ("P", Termination.TOO_FAST)]
    assert_stopped_within_limits(outputs)


def test_a_motion_that_fails_only_when_its_turn_comes_is_told_and_the_arm_stays() -> None:
    belt = Conveyor(lambda _: (3.0, 0.0, 0.0, 0.0))
    gen = puma_generator()
    gen.push(to(at_park(belt.trsf), MotionMode.JOINT))
    outputs = run_on(gen, belt, 20)
    assert ended(outputs) == [("P", Termination.UNREACHABLE)]
    assert (outputs[-1].q == PARK).all()
    assert not gen.busy


def test_an_interruption_into_what_turns_out_impossible_stops_the_arm_with_the_codes_of_both() -> None:
    belt = Conveyor(lambda _: (3.0, 0.0, 0.0, 0.0))
    gen = puma_generator()
    gen.push(to(at_park(shift(y=0.2), name="first")))

    def interfere(tick: int) -> None:
        if tick == 20:
            gen.push(to(at_park(belt.trsf, name="far"), MotionMode.JOINT))
            gen.skip(9)

    outputs = run_on(gen, belt, 60, interfere)
    assert ended(outputs) == [("far", Termination.UNREACHABLE), ("first", 9)]
    assert_stopped_within_limits(outputs)


# ---------------------------------------------------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    ("request_", "error", "words"),
    [
        (lambda: to(at_park(shift(x=2.0))), Unreachable, "move to P: configuration 'lun'.* out of the arm's reach"),
        (
            lambda: to(at_park(shift(y=0.1)), MotionMode.JOINT, branch=RUN),
            JointLimit,
            "move to P: .*'run'.* would be at",
        ),
        (lambda: to(at_park(shift(y=0.3)), speed=Duration(0.2)), MotionError, "rad/s.*give it .* ms or more"),
        (lambda: to(at_park(shift(y=0.1)), speed=Duration(0.4), transition_s=0.0), MotionError, "give the transition"),
    ],
)
def test_what_the_arm_cannot_do_in_cartesian_space_is_refused_with_the_reason(request_, error, words) -> None:
    gen = puma_generator()
    with pytest.raises(error, match=words):
        gen.push(request_())
    assert gen.waiting == 0


def test_a_straight_line_from_a_singular_pose_is_refused_and_joint_mode_is_not() -> None:
    gen = puma_generator(PARK * [1, 1, 1, 1, 0, 1])
    equation = at_park()
    with pytest.raises(Singular, match="joints 4 and 6 are in line"):
        gen.push(to(equation))
    gen.push(to(equation, MotionMode.JOINT, speed=SpeedShare(0.5)))
    assert list(run(gen))[-1].q == pytest.approx(PARK, abs=1e-9)


def test_an_arm_without_inverse_kinematics_takes_joint_positions_only() -> None:
    gen = generator()
    with pytest.raises(MotionError, match="no inverse kinematics"):
        gen.push(to(at_park()))
    with pytest.raises(MotionError, match="a tool speed needs the arm's kinematics"):
        gen.push(MoveRequest("q", np.array([0.1, 0.0]), SLOW))


@pytest.mark.parametrize("make", [lambda: ToolSpeed(0.0, 1.0), lambda: ToolSpeed(0.1, -1.0)])
def test_a_tool_speed_that_is_no_speed_is_refused(make) -> None:
    with pytest.raises(MotionError, match="must be positive"):
        make()
