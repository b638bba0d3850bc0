"""Everything that can break on the paper's fast leg, at two rates and two places: what the servo does, and how soon.

The table is the promise. Each row is injected into the emulated board, or into the stream, while the arm moves at about
1 rad/s; the tests assert the code, the stop, the tick of the reaction, how far the arm still goes, and that the
disturbance really came. Then the way out: a clear never moves the arm, is refused while the cause is there, and power
comes back only when it is asked for.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from qrobot.faultcodes import FaultCode
from qrobot.hwif.registers import DAC_ZERO, DISCRETE, DISCRETE_POWER
from qrobot.hwif.trace import load_head
from qrobot.modecodes import Mode
from qrobot.servo.modes import StopCategory
from qrobot.servo.stages.setpoint_stream import SILENCE_MARGIN
from qrobot.servo.stop_categories import stop_category
from tests.support.campaign import FRAME_S, PUMA, SAMPLE_S, FastLeg, Outcome, fast_leg, writes_since

RATES = pytest.mark.parametrize("rate_hz", [1000.0, 4000.0])
PLACES = pytest.mark.parametrize("share", [0.4, 0.6])
COAST_RAD = 0.13  # how far the wrist, which has no brakes, runs on at 1 rad/s when power goes
BRAKED_RAD = 0.03  # how far the braked joints do


@dataclass(frozen=True)
class Case:
    """A fault of the board and what it has to lead to.

    Attributes:
        line: the fault, as it is injected.
        codes: what the servo may call it at first; several where two watches race.
        ends: what the arm is cut for in the end, where that is not the first code. A COLLISION without is not cut: the
            joint comes to rest in the stop, and is held.
        ticks, ms: the bound on the reaction, whichever is longer.
        coast_rad: how far any joint may go after the reaction.
        stays: the servo sees, without moving the arm, that the cause persists: a clear is refused.
    """

    line: str
    codes: tuple[FaultCode, ...]
    ticks: int
    ms: float = 0.0
    coast_rad: float = COAST_RAD
    stays: bool = False
    ends: tuple[FaultCode, ...] = ()

    def within(self, rate_hz: float) -> int:
        """Bound in ticks at a rate."""
        return max(self.ticks, math.ceil(self.ms * 1e-3 * rate_hz))


F = FaultCode
CASES = (
    # sensors
    Case("encoder:1 jump -3000", (F.ENC_JUMP,), 3),
    Case("encoder:2 jump 3000", (F.ENC_JUMP,), 3),
    Case("encoder:6 wrong 900", (F.ENC_JUMP,), 3),
    Case("encoder:3 garbage", (F.ENC_JUMP,), 3),
    Case("encoder:2 stuck", (F.ENC_STUCK,), 3, 3.0),
    Case("encoder:6 stuck", (F.ENC_STUCK,), 3, 3.0),
    Case("encoder:1 reversed", (F.COLLISION,), 3, 3.5, ends=(F.RUNAWAY,)),
    Case("encoder:3 reversed", (F.COLLISION,), 3, 4.0, ends=(F.RUNAWAY,)),
    Case("encoder:4 reversed", (F.COLLISION,), 3, 3.5, ends=(F.RUNAWAY,)),
    Case("board off", (F.BOARD_GONE,), 1, stays=True),
    Case("board off 0", (F.ESTOP,), 1, stays=True),
    Case("board frozen", (F.BOARD_GONE,), 5, 1.25, stays=True),
    Case("board slow 30", (F.BOARD_GONE,), 6, 1.5),
    Case("board intermittent 0.9", (F.BOARD_GONE,), 3),
    Case("encoder:1 scale -0.5", (F.COLLISION,), 3, 15.0, ends=(F.DAC_STUCK,)),
    # actuators and power
    Case("dac:2 full -1", (F.RUNAWAY,), 3, 10.0),
    Case("dac:5 full -1", (F.RUNAWAY,), 3, 10.0),
    Case("dac:2 full", (F.COLLISION,), 3, 15.0, ends=(F.RUNAWAY,)),
    Case("dac:5 full", (F.COLLISION,), 3, 15.0, ends=(F.RUNAWAY,)),
    Case("dac:1 dead", (F.COLLISION,), 3, 50.0),
    Case("dac:2 dead", (F.RUNAWAY,), 3, 150.0),
    Case("arm:1 pushed 176", (F.COLLISION,), 3, 15.0, ends=(F.DAC_STUCK,)),
    Case("brake:2 stuck", (F.ENC_STUCK, F.COLLISION), 3, 25.0),
    Case("power drop", (F.POWER_LOST,), 1),
    Case("power off +100ms", (F.POWER_LOST,), 1),
    Case("estop pressed", (F.ESTOP,), 2, stays=True),
)
REACTING = pytest.mark.parametrize("case", CASES, ids=lambda case: case.line)


@pytest.mark.sampled(26)
@REACTING
@RATES
@PLACES
def test_what_breaks_on_the_way_stops_the_arm_in_time(case: Case, rate_hz: float, share: float) -> None:
    leg = FastLeg(rate_hz)
    leg.go(share)
    frames = 2 + math.ceil(case.within(rate_hz) / rate_hz / FRAME_S)
    outcome = leg.suffer(case.line, frames)
    assert outcome.acted > 0
    assert outcome.code in case.codes
    assert 0 < outcome.reaction <= case.within(rate_hz)
    assert outcome.off_path() < 1e-3
    _the_stop_is_that_of_its_category(outcome)
    leg.frames(10)
    assert outcome.travel().max() <= case.coast_rad
    if outcome.code is F.COLLISION and not case.ends:
        assert leg.mode is Mode.HOLDING
        assert np.abs(leg.rig.emulator.v).max() < 0.02
        return
    assert leg.mode is Mode.FAULT
    assert FaultCode(leg.rig.mailbox.snapshot().fault) in (case.ends or case.codes)
    _the_way_out_is_a_clear_and_a_request(leg, case)


def _the_stop_is_that_of_its_category(outcome: Outcome) -> None:
    if stop_category(outcome.code) is StopCategory.CATEGORY_0:
        assert outcome.modes == [Mode.TRACKING, Mode.FAULT]
        assert outcome.cut_at_once
    else:
        assert outcome.modes[1] is Mode.STOPPING


def _the_way_out_is_a_clear_and_a_request(leg: FastLeg, case: Case) -> None:
    rig = leg.rig
    if case.stays:
        rig.mailbox.request_clear()
        rig.run_for(0.15)
        assert (leg.mode, leg.event) == (Mode.FAULT, FaultCode.RESET_DENIED)
    rig.emulator.faults.clear()
    rig.run_for(0.4)
    q, head = rig.emulator.q, int(load_head(rig.board))
    rig.mailbox.request_clear()
    rig.run_for(0.15)
    assert leg.mode is Mode.OFF
    new = writes_since(rig.board, head)
    assert len(new) > 0
    assert np.all(new[new[:, 2] != DISCRETE, 3] == DAC_ZERO)
    assert not np.any(new[new[:, 2] == DISCRETE, 3] & DISCRETE_POWER)
    assert not rig.emulator.powered
    np.testing.assert_allclose(rig.emulator.q, q, atol=1e-4)
    rig.mailbox.request_power(False)
    rig.ticks(2)
    rig.mailbox.request_power(True)
    rig.run_for(0.1)
    assert leg.mode in (Mode.HOLDING, Mode.UNCALIBRATED)
    assert np.abs(rig.emulator.q - q)[:3].max() < 0.02


HARMLESS = ("encoder:2 scale 1.01", "dac:2 gain 0.8", "arm:3 pushed 2", "pot:1 dead")


@RATES
@pytest.mark.parametrize("line", HARMLESS)
def test_what_the_law_can_carry_does_not_stop_the_arm(line: str, rate_hz: float) -> None:
    leg = FastLeg(rate_hz)
    leg.go(0.4)
    outcome = leg.suffer(line, 12)
    assert outcome.rig.emulator.faults.report(outcome.place).steps > 0
    assert outcome.modes == [Mode.TRACKING]
    assert np.abs(outcome.rows["q_ref"] - outcome.rows["q"]).max() < 0.05


# ------------------------------------------------------------------------------------------------------- the stream


@dataclass(frozen=True)
class Mishap:
    """Something that goes wrong with the setpoints, and the code it leads to.

    Attributes:
        frames: what the program does from now on.
        code: of the stop; NONE when nothing stops.
        ms: bound, from the first thing that is wrong.
    """

    name: str
    frames: Callable[[FastLeg], object]
    code: FaultCode
    ms: float = 0.0


def _skip(frames: int) -> Callable[[FastLeg], object]:
    def act(leg: FastLeg) -> None:
        leg.seq += frames
        leg.frames(frames)
        leg.fly(12)

    return act


def _repeat(leg: FastLeg) -> None:
    for _ in range(12):
        leg.send()
        leg.send(seq=leg.seq - 1)
        leg.frames(1)


def _spoil(change: Callable[[np.ndarray], object]) -> Callable[[FastLeg], object]:
    def act(leg: FastLeg) -> None:
        wrong = fast_leg()[leg.seq].copy()
        change(wrong)
        leg.send(wrong)
        leg.frames(1)
        leg.fly(12)

    return act


def _skip_late(leg: FastLeg) -> None:
    """One frame is lost, and those behind it come a seventh of a period late."""
    leg.seq += 1
    leg.frames(1)
    leg.true_q.append(leg.rig.emulator.q)
    leg.rig.run_for(SAMPLE_S)
    leg.fly(12)


def _set(joint: int, value: float) -> Callable[[np.ndarray], object]:
    def change(q: np.ndarray) -> None:
        q[joint] = value

    return change


LATE_MS = 1e3 * FRAME_S
MISHAPS = (
    Mishap("one frame lost", _skip(1), F.NONE),
    Mishap("one frame lost, the others late", _skip_late, F.NONE),
    Mishap("frames twice", _repeat, F.NONE),
    Mishap("two frames lost", _skip(2), F.STREAM_LOST, (2 + SILENCE_MARGIN) * LATE_MS),
    Mishap("the program is gone", lambda leg: leg.frames(12), F.STREAM_LOST, (2 + SILENCE_MARGIN) * LATE_MS),
    Mishap("not a number", _spoil(_set(2, math.nan)), F.SP_INVALID, 2 * LATE_MS),
    Mishap("infinity", _spoil(_set(0, -math.inf)), F.SP_INVALID, 2 * LATE_MS),
    Mishap("out of range", _spoil(_set(1, PUMA.limits.q_max[1] + 0.01)), F.SP_LIMIT, 2 * LATE_MS),
    Mishap("a step", _spoil(lambda q: q.__isub__(0.2)), F.SP_STEP, 2 * LATE_MS),
)


@pytest.mark.sampled(9)
@pytest.mark.parametrize("mishap", MISHAPS, ids=lambda mishap: mishap.name)
@RATES
@PLACES
def test_what_goes_wrong_with_the_stream_ends_on_the_path(mishap: Mishap, rate_hz: float, share: float) -> None:
    leg = FastLeg(rate_hz)
    leg.go(share)
    outcome = leg.watch(lambda: mishap.frames(leg))
    assert outcome.code is mishap.code
    assert outcome.off_path() < 1e-3
    speed = np.abs(outcome.rows["v_ref"]).max(axis=0)
    assert np.all(np.abs(np.diff(outcome.rows["q_ref"], axis=0)) <= 1.05 * speed / rate_hz + 1e-9)
    if mishap.code is F.NONE:
        assert outcome.modes == [Mode.TRACKING]
        return
    assert outcome.modes == [Mode.TRACKING, Mode.STOPPING, Mode.HOLDING]
    assert outcome.reaction / rate_hz <= mishap.ms * 1e-3 + SAMPLE_S
    assert leg.rig.emulator.powered
    assert np.abs(leg.rig.emulator.v).max() < 0.01
    assert outcome.travel().max() < 0.2


# --------------------------------------------------------------------------------------------------------- powering up


@RATES
def test_power_that_does_not_come_on_is_given_up_after_three_seconds(rate_hz: float) -> None:
    leg = FastLeg(rate_hz, "power off")
    leg.rig.ticks(3)
    leg.rig.mailbox.request_power(True)
    leg.rig.run_for(2.9)
    assert leg.mode is Mode.POWERING
    leg.rig.run_for(0.2)
    assert (leg.mode, leg.event) == (Mode.OFF, F.POWER_NO_ACK)
    assert leg.rig.emulator.faults.report(0).acted > 0


@pytest.mark.parametrize(("line", "code"), [("estop pressed", F.ESTOP), ("board off", F.BOARD_GONE)])
def test_power_is_refused_while_something_is_wrong(line: str, code: FaultCode) -> None:
    leg = FastLeg(1000.0, line)
    leg.rig.ticks(5)
    leg.rig.mailbox.request_power(True)
    leg.rig.run_for(0.2)
    assert (leg.mode, leg.event) == (Mode.OFF, code)
    assert not leg.rig.emulator.powered


def test_the_same_faults_give_the_same_run() -> None:
    def run() -> bytes:
        leg = FastLeg(1000.0)
        leg.go(0.4)
        leg.suffer("encoder:3 garbage @20ms +1ms", 4)
        return leg.rig.rows().tobytes()

    assert run() == run()
