"""One frame lost where a motion turns as hard as it can, or none: the arm goes on, no faster than it may be."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from qrobot.arrays import Floats
from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.motion import Generator, JointSpeed, MoveRequest, motion_limits
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.campaign import PUMA, N

PERIOD_S = 0.1  # the longest there is: what a lost frame does grows with its length
AFTER = 9  # frames that are played after the lost one: the turn is over, or the arm at rest
FASTEST = 1.01  # of v_max: the limit, and a little between the instants at which the speed is looked at


@cache
def there_and_back(speed: float) -> Floats:
    """Setpoints of the generator from the end position to the park position and back, without a rest between."""
    places = PUMA.poses["end"], PUMA.poses["park"]
    generator = Generator(motion_limits(PUMA), PERIOD_S, places[0])
    for place in (places[1], places[0]):
        generator.push(MoveRequest("place", place, JointSpeed(speed)))
    rows, tick, moving = [places[0]], 0, True
    while moving:
        tick += 1
        output = generator.update(tick)
        rows.append(output.q)
        moving = output.moving
    return np.array([*rows, *[rows[-1]] * AFTER])


@cache
def hard_turn(joint: int) -> Floats:
    """One joint to 0.9 v_max and back at 0.8 a_max, sampled from the exact motion; no generator asks for that much.

    Ramps may be shorter than a frame.
    """
    v, a = 0.9 * PUMA.limits.v_max[joint], 0.8 * PUMA.limits.a_max[joint]
    ramp = v / a
    times = np.cumsum([0.0, ramp, 0.15, 2.0 * ramp, 0.15, ramp])
    fine = np.arange(0.0, times[-1] + AFTER * PERIOD_S, 1e-4)
    way = np.cumsum(np.interp(fine, times, [0.0, v, v, -v, -v, 0.0])) * 1e-4
    rows = np.tile(PUMA.poses["end"], (int(fine[-1] / PERIOD_S), 1))
    rows[:, joint] += np.interp(PERIOD_S * np.arange(len(rows)), fine, way)
    return rows


def without(stream: Floats, *lost: int, interpolation: str = "quintic") -> LockstepRig:
    """The arm after a stream of which some frames never came."""
    rig = LockstepRig(PUMA, ServoSettings(interpolation=interpolation), Emulator(PUMA, start="end", physics="rigid"))
    rig.ticks(3)
    rig.mailbox.request_power(True)
    rig.run_for(0.1)
    for seq, q in enumerate(stream[: max(lost, default=len(stream)) + AFTER]):
        if seq not in lost:
            modes = [POSITION_SETPOINT] * N
            rig.mailbox.push_setpoint(1, seq, rig.now_ns, round(PERIOD_S * 1e9), modes, q.tolist())
        rig.run_for(PERIOD_S)
    assert (rig.mailbox.snapshot().missed_frames >= 1) == bool(lost)
    return rig


def highest(rig: LockstepRig, field: str) -> float:
    """Largest speed of a kind that any joint had under torque, as a share of its limit."""
    rows = rig.rows()
    speeds = np.abs(rows[field][rows["mode"] >= Mode.HOLDING])
    return float((speeds.max(axis=0) / PUMA.limits.v_max).max())


@pytest.mark.parametrize("interpolation", ["quintic", "cubic"])
@pytest.mark.parametrize("lost", [17, 18, 19])
def test_no_frame_of_a_motion_that_turns_back_stops_the_arm_when_it_is_lost(lost: int, interpolation: str) -> None:
    rig = without(there_and_back(1.05), lost, interpolation=interpolation)
    state = rig.mailbox.snapshot()
    assert (Mode(state.mode), FaultCode(state.event)) == (Mode.TRACKING, FaultCode.NONE)
    assert highest(rig, "v_ref") < 0.7  # the motion itself has 0.53


@pytest.mark.parametrize("lost", [4, 13, 14, 15])
def test_nor_does_one_of_a_faster_motion(lost: int) -> None:
    rig = without(there_and_back(1.4), lost)
    state = rig.mailbox.snapshot()
    assert (Mode(state.mode), FaultCode(state.event)) == (Mode.TRACKING, FaultCode.NONE)
    assert highest(rig, "v_ref") < 0.9  # the motion itself has 0.75


@pytest.mark.sampled(15)
@pytest.mark.parametrize("joint", range(N))
@pytest.mark.parametrize("lost", [3, 4, 5, 6, None])
def test_nor_does_one_of_a_turn_at_nearly_all_an_arm_can_do_within_a_frame(joint: int, lost: int | None) -> None:
    rig = without(hard_turn(joint), *([] if lost is None else [lost]))
    state = rig.mailbox.snapshot()
    assert (Mode(state.mode), FaultCode(state.event)) == (Mode.TRACKING, FaultCode.NONE)
    assert highest(rig, "v_ref") <= FASTEST
    assert highest(rig, "v") <= PUMA.guard.velocity_factor


@pytest.mark.parametrize("first", [2, 3])
def test_a_motion_goes_on_without_every_second_of_its_frames(first: int) -> None:
    stream = there_and_back(1.05)
    rig = without(stream, *range(first, len(stream) - AFTER, 2))
    state = rig.mailbox.snapshot()
    assert (Mode(state.mode), FaultCode(state.event)) == (Mode.TRACKING, FaultCode.NONE)
    assert highest(rig, "v_ref") < 0.7
