"""Whatever is asked of the servo and whatever breaks around it, in any order: what must hold at every tick."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from qrobot.hwif.board_memory import Lane
from qrobot.hwif.registers import DAC_ZERO, DISCRETE, DISCRETE_HAND_CLOSE, DISCRETE_HAND_OPEN, STATUS_ESTOP_OK
from qrobot.modecodes import Mode
from qrobot.servo.kernels.interpolation_polynomials import FORMS
from qrobot.servo.kernels.velocity import ESTIMATORS
from qrobot.servo.laws.law import law
from qrobot.servo.laws.shipped import LAWS
from qrobot.servo.memory.setpoint_queue import TORQUE_SETPOINT
from qrobot.servo.modes import gives_torque, may_follow, wants_power
from tests.support.servo_bench import Program, ServoBench, cruise
from tests.support.thorough import examples

N = 6
TORQUE = np.array([gives_torque(mode) for mode in Mode])
joints = st.integers(0, N - 1)
nasty = st.sampled_from([math.nan, math.inf, -math.inf, 1e300, -1e300, 1e-300, 10.0, -10.0, 0.05, -0.02])


@law
def erratic(
    q_ref: Any, v_ref: Any, a_ref: Any, q: Any, v: Any, gravity: Any, friction: Any,
    sensors: Any, gains: Any, memory: Any, tau: Any,
) -> None:  # fmt: skip
    """Wild torques, and after a while no number at all."""
    memory[0] += 1.0
    for j in range(tau.size):
        tau[j] = 1e4 * np.sin(7.0 * memory[0] + j)
    if memory[0] > 70.0:
        tau[int(memory[0]) % tau.size] = np.nan


class ServoMachine(RuleBasedStateMachine):
    """A servo on the bench with somebody at the panel who must not be trusted."""

    @initialize(
        rate_hz=st.sampled_from([1000.0, 4000.0]),
        law_name=st.sampled_from([*LAWS, "erratic"]),
        calibrated=st.integers(0, 7).map(bool),
        velocity=st.sampled_from([*ESTIMATORS]),
        interpolation=st.sampled_from([*FORMS]),
    )
    def begin(self, rate_hz: float, law_name: str, calibrated: bool, velocity: str, interpolation: str) -> None:
        chosen = erratic if law_name == "erratic" else law_name
        self.bench = ServoBench(
            rate_hz=rate_hz, law=chosen, velocity=velocity, interpolation=interpolation, guarded=True,
            calibrated=calibrated, pose="end",
        )  # fmt: skip
        self.program: Program | None = None
        self.stream = 0
        self.asked = self.power = 0
        self.seen_rows = self.seen_writes = self.powered_up = 0
        self.bench.hold()
        self.asked = self.power = 1

    # ------------------------------------------------------------------------------------------------ time and requests

    @rule(ticks=st.sampled_from([1, 2, 5, 30, 80, 120]))
    def run(self, ticks: int) -> None:
        self.bench.tick(ticks)

    @rule(on=st.booleans())
    def request_power(self, on: bool) -> None:
        self.asked += int(on) > self.power
        self.power = int(on)
        self.bench.mailbox.request_power(on)
        self.bench.tick(2)

    @rule()
    def request_clear(self) -> None:
        self.bench.mail.guardian.takeover = 0
        self.bench.mailbox.request_clear()
        self.bench.tick(2)

    @rule()
    def request_stop(self) -> None:
        self.bench.mailbox.request_stop()

    @rule(hand=st.integers(0, 3))
    def request_hand(self, hand: int) -> None:
        self.bench.mailbox.request_hand(hand)

    @rule()
    def make_everything_well_and_power_on(self) -> None:
        self.end_program()
        bench = self.bench
        bench.estop_ok = bench.panel = bench.beating = bench.follows = True
        bench.frozen = False
        bench.status, bench.slip = None, {}
        bench.mail.guardian.takeover = 0
        self.request_power(False)
        for _ in range(400):
            if bench.mode in (Mode.OFF, Mode.FAULT):
                break
            bench.tick()
        self.request_clear()
        bench.tick(40)  # the velocity estimate settles
        self.request_power(True)

    # -------------------------------------------------------------------------------------------------------- programs

    @rule(
        joint=joints,
        speed=st.sampled_from([-0.5, 0.3, 0.8, -1.0, 4.0]),
        ramp_s=st.sampled_from([0.4, 0.5, 0.05]),
        period_ms=st.sampled_from([1, 5, 28, 100]),
        skew=st.sampled_from([-0.01, 0.0, 0.05]),
    )
    def start_program(self, joint: int, speed: float, ramp_s: float, period_ms: int, skew: float) -> None:
        if self.bench.mode is Mode.TRACKING:
            self.end_program()
        else:
            self.make_everything_well_and_power_on()
        velocity = np.zeros(N)
        velocity[joint] = speed
        self.stream += 1
        path = cruise(self.bench.snapshot.q_setpoint, velocity, ramp_s)
        self.program = Program(self.bench, path, period_ms * 1_000_000, self.stream, skew)
        self.bench.before.append(self.program.step)
        self.bench.tick(150)

    @rule()
    def end_program(self) -> None:
        if self.program is not None:
            self.bench.before.remove(self.program.step)
        self.program = None

    @precondition(lambda self: self.program is not None)
    @rule(joint=joints, mode=st.sampled_from([0, 1, 2]), value=nasty)
    def spoil_the_program(self, joint: int, mode: int, value: float) -> None:
        assert self.program is not None
        at = self.program.seq + 1

        def edit(seq: int, modes: list[int], values: np.ndarray) -> None:
            if seq == at or (mode == TORQUE_SETPOINT and seq > at):
                modes[joint], values[joint] = mode, value

        self.program.edit = edit
        self.bench.tick(40)

    @precondition(lambda self: self.program is not None)
    @rule(count=st.integers(1, 3))
    def lose_frames(self, count: int) -> None:
        assert self.program is not None
        self.program.dropped |= set(range(self.program.seq, self.program.seq + count))

    # -------------------------------------------------------------------------------------------------------- mishaps

    @rule(
        what=st.sampled_from(["estop_ok", "panel", "beating", "follows", "frozen"]),
        value=st.booleans(),
        ticks=st.sampled_from([1, 3, 20]),
    )
    def something_happens(self, what: str, value: bool, ticks: int) -> None:
        setattr(self.bench, what, value)
        self.bench.tick(ticks)

    @rule(ticks=st.sampled_from([1, 3, 70]))
    def board_takes_nothing_for_a_while(self, ticks: int) -> None:
        self.bench.deaf = True
        self.bench.tick(ticks)
        self.bench.deaf = False
        self.bench.tick(2)

    @rule(status=st.sampled_from([None, 0x0000, 0xFFFF]), ticks=st.sampled_from([1, 3, 20]))
    def status_shows(self, status: int | None, ticks: int) -> None:
        self.bench.status = status
        self.bench.tick(ticks)

    @rule(joint=joints, counts=st.integers(-40_000, 40_000), ticks=st.integers(1, 4))
    def encoder_slips(self, joint: int, counts: int, ticks: int) -> None:
        self.bench.slip = {joint: counts}
        self.bench.tick(ticks)
        self.bench.slip = {}

    @rule()
    def guardian_takes_the_board(self) -> None:
        self.bench.mail.guardian.trips += 1
        self.bench.mail.guardian.takeover = 1
        self.bench.mail.guardian.t_ns = self.bench.now_ns  # it lives
        written = sum(write.lane is Lane.SERVO for write in self.bench.writes)
        self.bench.tick(3)
        assert sum(write.lane is Lane.SERVO for write in self.bench.writes) == written

    @rule(cycles=st.integers(1, 10))
    def loop_is_late(self, cycles: int) -> None:
        self.bench.skip(cycles)
        self.bench.tick()

    # ------------------------------------------------------------------------------------------------------ invariants

    @invariant()
    def every_tick_keeps_the_promises(self) -> None:
        if not hasattr(self, "bench"):
            return
        new = self.bench.rows(max(0, self.seen_rows - 1))  # the newest one again: what follows is judged with it
        self.seen_rows = max(0, self.seen_rows - 1) + len(new)
        self._torque_only_where_it_belongs(new)
        self._modes_follow_the_table(new)
        self._no_bad_number(new)
        self._reference_has_no_step(new)
        self._power_only_when_wanted()
        self._none_with_the_emergency_stop_open()

    def _torque_only_where_it_belongs(self, rows: Any) -> None:
        without = rows[~TORQUE[rows["mode"]]]
        assert np.all(without["dac"] == DAC_ZERO)
        assert np.all(without["tau"] == 0.0)

    def _modes_follow_the_table(self, rows: Any) -> None:
        for before, after in pairwise(rows["mode"].tolist()):
            refused = before == Mode.HOLDING and after == Mode.STOPPING  # TRACKING lasted no cycle: a bad first frame
            assert before == after or refused or may_follow(before, after), f"{Mode(before).name} -> {Mode(after).name}"
            self.powered_up += before == Mode.OFF and after == Mode.POWERING
        assert self.powered_up <= self.asked

    def _no_bad_number(self, rows: Any) -> None:
        for name in ("q_ref", "v_ref", "a_ref", "q", "v", "tau"):
            assert np.all(np.isfinite(rows[name])), name
        assert np.all(np.abs(rows["tau"]) <= self.bench.robot.guard.tau_max)
        assert np.all((rows["dac"] >= 0) & (rows["dac"] <= 0xFFF))

    def _reference_has_no_step(self, rows: Any) -> None:
        driven = np.isin(rows["mode"], [Mode.TRACKING, Mode.STOPPING])
        both = driven[1:] & driven[:-1]
        elapsed_s = np.diff(rows["t_ns"]) * 1e-9
        speed = np.abs(np.diff(rows["q_ref"], axis=0)) / elapsed_s[:, None]
        assert np.all(speed[both] <= 1.3 * self.bench.robot.limits.v_max + 1e-9)

    def _power_only_when_wanted(self) -> None:
        if not self.bench.mail.guardian.takeover:
            assert self.bench.powered == wants_power(self.bench.mode)
        hands = DISCRETE_HAND_OPEN | DISCRETE_HAND_CLOSE
        new, self.seen_writes = self.bench.writes[self.seen_writes :], len(self.bench.writes)
        assert all(write.value & hands for write in new if write.offset == DISCRETE)  # never both on

    def _none_with_the_emergency_stop_open(self) -> None:
        state = self.bench.state
        if state.image_ok and not state.status & STATUS_ESTOP_OK:
            assert not wants_power(self.bench.mode)


TestServo = ServoMachine.TestCase
TestServo.settings = settings(max_examples=examples(30), stateful_step_count=20)
