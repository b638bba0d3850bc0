"""Every primitive refuses arguments that make no sense, says which and why, and nothing moves."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from qrobot import rccl
from qrobot.errors import ConfigError, MotionError, QRobotError
from qrobot.rccl import (
    EQ,
    TL,
    gentr_eul,
    gentr_pao,
    gentr_rot,
    gentr_rpy,
    gentr_trsl,
    makeposition,
    newtrans,
    rot,
    t6,
    trsl,
    xunit,
)
from qrobot.rccl.offline import OfflineLink
from tests.support.puma import PARK

NAN, INF, HUGE = float("nan"), float("inf"), 10**5000
E = gentr_trsl("E", 0, 0, 100)
P = makeposition("P", t6, E, EQ, gentr_trsl("A", 500, 0, 300), TL, E)


@pytest.fixture(scope="module")
def arm() -> Iterator[rccl.Channel]:
    with rccl.use(OfflineLink), rccl.control() as arm:
        yield arm


WORLD = [
    (lambda: newtrans("T", "constant"), "kind 'constant' is none of"),
    (lambda: newtrans("T", 5), "kind 5 is none of"),
    (lambda: gentr_trsl("T", NAN, 0, 0), "transform T: one of its numbers is not finite"),
    (lambda: gentr_trsl("T", 0, INF, 0), "transform T: one of its numbers is not finite"),
    (lambda: gentr_rot("T", 0, 0, 0, (0, 0, 0), 90), "axis needs a direction"),
    (lambda: gentr_rot("T", 0, 0, 0, (0, 1), 90), "in three numbers"),
    (lambda: gentr_rot("T", 0, 0, 0, xunit, NAN), "transform T: one of its numbers is not finite"),
    (lambda: gentr_eul("T", 0, 0, 0, 0, INF, 0), "transform T: one of its numbers is not finite"),
    (lambda: gentr_rpy("T", 0, 0, 0, 0, 0, NAN), "transform T: one of its numbers is not finite"),
    (lambda: gentr_pao("T", (0, 0, 0), xunit, xunit), "must not be parallel"),
    (lambda: rot(newtrans("T"), (0, 0, 0), 5), "axis needs a direction"),
    (lambda: trsl(newtrans("T"), 0, 0, NAN), "transform T: one of its numbers is not finite"),
    (lambda: makeposition("P", t6, EQ, E), "write "),
    (lambda: makeposition("P", t6, E, TL, EQ), "write "),
    (lambda: makeposition("P", t6, "E", EQ, E, TL, E), "makeposition P: 'E' is no transform"),
    (lambda: makeposition("P", t6, EQ, E, TL, None), "makeposition P: None is no transform"),
    (lambda: makeposition("P", E, EQ, E, TL, E), "T6 must stand exactly once"),
    (lambda: makeposition("P", t6, EQ, E, TL, newtrans("X")), "controlled frame X must"),
]

MOTIONS = [
    (lambda: rccl.pose("nowhere"), "no pose 'nowhere'; it has"),
    (lambda: rccl.jposition("p", [1, 2, 3]), "6 joints, not 3"),
    (lambda: rccl.jposition("p", [0, 0, 0, 0, 0, NAN]), "position p: nan is not a finite number"),
    (lambda: rccl.jposition("p", [0, 0, 0, 0, 0, "5"]), "'5' is not a finite number"),
    (lambda: rccl.jposition("p", [0, 0, 0, 0, 0, 10**400]), "0 is not a finite number"),
    (lambda: rccl.jposition("p", [0, 0, 0, 0, 0, HUGE]), "position p: a number of thousands of digits is not a finite"),
    (lambda: rccl.jposition("p", HUGE), "6 numbers are needed, not a number of thousands of digits"),
    (lambda: rccl.program.arm().analog(HUGE, 1.0), "analog.a number of thousands of digits.: analogue outputs are"),
    (lambda: rccl.program.arm().signal(HUGE), "signal a number of thousands of digits: outputs are"),
    (lambda: rccl.nextmove(-HUGE), "must be a positive whole number"),
    (lambda: rccl.jposition("p", np.zeros((6, 2))), "is not a finite number"),
    (lambda: rccl.move(rccl.jposition("p", [200, 0, 0, 0, 0, 0])), r"move to p: joint 1 \(waist\)"),
    (lambda: rccl.move("park"), "move: a position is needed, from makeposition, jposition or pose, not 'park'"),
    (lambda: rccl.move(PARK), "move: a position is needed"),
    (lambda: rccl.move(None), "move: a position is needed"),
    (lambda: rccl.setmode("curved"), "neither 'joint' nor 'cartesian'"),
    (lambda: rccl.setmode("c", "spiral"), "turn 'spiral'"),
    (lambda: rccl.setvel(0, 90), "speed of the tool must be positive"),
    (lambda: rccl.setvel(100, -1), "turning speed of the tool must be positive"),
    (lambda: rccl.setvel(NAN, 90), "setvel: nan is not a finite number"),
    (lambda: rccl.setvel("fast", 90), "setvel: 'fast' is not a finite number"),
    (rccl.setjvel, "either a speed or a share"),
    (lambda: rccl.setjvel(1.0, share=0.5), "either a speed or a share"),
    (lambda: rccl.setjvel(0.0), "speed of a motion must be positive"),
    (lambda: rccl.setjvel(share=0), "above 0 and at most 1"),
    (lambda: rccl.setjvel(INF), "setjvel: inf is not a finite number"),
    (lambda: rccl.setconf("xyz"), "configuration 'xyz'"),
    (lambda: rccl.setconf("lr"), "configuration 'lr'"),
    (lambda: rccl.setconf(3), "letters are needed"),
    (lambda: rccl.sample(0), "1 to 100 ms are possible"),
    (lambda: rccl.setime(-1, 400), "setime"),
    (lambda: rccl.setime(100, 0), "setime"),
    (lambda: rccl.setime(NAN, 400), "setime: nan is not"),
    (lambda: rccl.evalfn(7), "evalfn: a function is needed, not 7"),
    (lambda: rccl.distance("up", 1.0), "name directions out of 'dx dy dz rx ry rz'"),
    (lambda: rccl.distance("dx dy", 1.0), "one value each"),
    (lambda: rccl.distance("dx", INF), "distance: inf is not"),
    (lambda: rccl.distance(5, 1.0), "name directions"),
    (lambda: rccl.comply("dz", 0.0), "name directions out of 'fx fy fz mx my mz'"),
    (lambda: rccl.comply("fz", NAN), "comply: nan is not"),
    (lambda: rccl.lock("fz"), "the arm complies along nothing"),
    (lambda: rccl.lock(""), "name directions"),
    (lambda: rccl.lock(None), "name directions"),
    (lambda: rccl.limit("fz", -3.0), "must be positive"),
    (lambda: rccl.limit("gz", 1.0), "name directions"),
    (lambda: rccl.limit("fz", NAN), "limit: nan is not"),
    (lambda: rccl.update(newtrans("X"), P), "cannot be solved for X"),
    (lambda: rccl.update(E, rccl.park), "position park has no equation"),
    (lambda: rccl.update(E, "P"), "update: a position is needed"),
    (lambda: rccl.stop(-1), "no negative time"),
    (lambda: rccl.stop(NAN), "stop: nan is not"),
    (lambda: rccl.nextmove(0), "must be a positive whole number"),
    (lambda: rccl.nextmove(0.5), "must be a positive whole number"),
    (lambda: rccl.waitfor(P), "waitfor: an event is needed"),
    (lambda: rccl.waitfor(rccl.park.end), r"waitfor\(park.end\): no motion is left"),
    (lambda: rccl.waitas(True), "waitas: a function is needed, not True"),
    (lambda: rccl.program.arm().each_sample(5), "each_sample: a function is needed"),
]


@pytest.mark.parametrize(("deed", "words"), WORLD)
def test_the_world_model_takes_no_nonsense(deed, words) -> None:
    with pytest.raises(MotionError, match=words):
        deed()


@pytest.mark.parametrize(("deed", "words"), MOTIONS)
def test_a_call_without_sense_is_refused_and_moves_nothing(arm: rccl.Channel, deed, words) -> None:
    with pytest.raises((MotionError, ConfigError), match=words):
        deed()
    assert not arm._task.busy
    assert arm.how.q == pytest.approx(PARK, abs=1e-12)


def test_after_all_that_the_arm_moves_as_if_nothing_had_been_said(arm: rccl.Channel) -> None:
    """The calls left nothing behind: neither a speed nor a direction to comply along, nor a motion."""
    for deed, _ in MOTIONS:
        with pytest.raises(QRobotError):
            deed()
    goal = arm.jposition("goal", np.degrees(PARK) + np.eye(6)[0] * 5.0)
    arm.move(goal)
    arm.waitfor(goal.end)
    assert goal.code == rccl.Termination.COMPLETED


@pytest.mark.parametrize("speed", [1e-320, 1e-200, 1e-100])
def test_a_speed_at_which_a_motion_never_ends_is_refused(arm: rccl.Channel, speed: float) -> None:
    arm.setjvel(speed)
    with pytest.raises(MotionError, match="more samples than can be counted"):
        arm.move(arm.jposition("P", [5, 0, 0, 0, 0, 0]))
    arm.setjvel(10)


@pytest.mark.parametrize("ms", [1e100, 1e203, 1e300])
def test_a_time_in_which_a_motion_never_ends_is_refused(arm: rccl.Channel, ms: float) -> None:
    arm.setime(0, ms)
    with pytest.raises(MotionError, match="more samples than can be counted"):
        arm.move(arm.jposition("P", [5, 0, 0, 0, 0, 0]))
    arm.setjvel(10)
