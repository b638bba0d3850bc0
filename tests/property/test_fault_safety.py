"""Commands, programs and faults of the board in any order: what no tick may show, with motors and arm behind it.

`test_servo_invariants` asks the same of the servo alone, on a board made of cardboard.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from qrobot.hwif.board_memory import FAULT_SLOTS
from qrobot.hwif.registers import DAC_ZERO, DISCRETE, DISCRETE_POWER, STATUS_ESTOP_OK
from qrobot.hwif.trace import load_head
from qrobot.modecodes import Mode
from qrobot.servo.modes import gives_torque, may_follow, wants_power
from qrobot.sim_board.faults import BOARD_DEAF, KINDS, Fault, FaultKind
from tests.support.campaign import PUMA, FastLeg, fast_leg, writes_since
from tests.support.thorough import examples

# Against a board that takes no writes the servo is helpless, whatever it does.
BREAKABLE = [kind for kind in KINDS if kind.number != BOARD_DEAF]
TORQUE = np.array([gives_torque(mode) for mode in Mode])


class FaultyArm(RuleBasedStateMachine):
    """An arm whose board breaks, and an operator who gives every command at any time."""

    @initialize(rate_hz=st.sampled_from([1000.0, 4000.0]))
    def begin(self, rate_hz: float) -> None:
        self.leg = FastLeg(rate_hz)
        self.rig = self.leg.rig
        self.seen = self.seen_writes = self.rises = self.clears = self.powered_up = self.left_fault = 0
        self.power = False
        self.request_power(True)

    # -------------------------------------------------------------------------------------------------- the operator

    @rule(on=st.booleans())
    def request_power(self, on: bool) -> None:
        self.rises += on and not self.power
        self.power = on
        self.rig.mailbox.request_power(on)
        self.rig.run_for(0.06)

    @rule()
    def request_clear(self) -> None:
        self.clears += 1
        self.rig.mailbox.request_clear()
        self.rig.run_for(0.12)

    @rule()
    def request_stop(self) -> None:
        self.rig.mailbox.request_stop()
        self.rig.run_for(0.05)

    @rule(frames=st.integers(1, 15))
    def fly(self, frames: int) -> None:
        """A program goes on, whatever became of the arm."""
        self.leg.fly(frames)

    @rule()
    def begin_again(self) -> None:
        """A program starts anew from where the reference stands, as a client that reconnects."""
        here = self.rig.mailbox.snapshot().q_setpoint
        nearest = int(np.argmin(np.abs(fast_leg() - here).max(axis=1)))
        self.leg.begin_stream(nearest, here - fast_leg()[nearest])
        self.leg.fly(6)

    # ---------------------------------------------------------------------------------------------------- what breaks

    @precondition(lambda self: len(self.rig.emulator.faults.reports()) < FAULT_SLOTS)
    @rule(
        kind=st.sampled_from(BREAKABLE),
        joint=st.integers(1, PUMA.n),
        sign=st.sampled_from([-1.0, 1.0]),
        lasts_ms=st.sampled_from([None, 1, 20, 200]),
    )
    def something_breaks(self, kind: FaultKind, joint: int, sign: float, lasts_ms: int | None) -> None:
        signed = kind.default is not None and kind.low < 0.0 and -kind.low >= abs(kind.default)
        self.rig.emulator.faults.add(
            Fault(
                kind.component,
                kind.name,
                joint if kind.per_joint else None,
                duration_s=None if kind.once or lasts_ms is None else lasts_ms * 1e-3,
                value=sign * kind.default if signed and kind.default is not None else None,
            )
        )
        self.leg.fly(4)

    @rule()
    def everything_is_repaired(self) -> None:
        self.rig.emulator.faults.clear()
        self.rig.run_for(0.1)

    # ------------------------------------------------------------------------------------------------------ invariants

    @invariant()
    def every_tick_keeps_the_promises(self) -> None:
        if not hasattr(self, "rig"):
            return
        rows = self.rig.rows()[self.seen :]
        self.seen += max(0, len(rows) - 1)  # the newest one again: what follows it is judged with it
        writes, self.seen_writes = writes_since(self.rig.board, self.seen_writes), int(load_head(self.rig.board))
        self._torque_only_where_it_belongs(rows, writes)
        self._modes_follow_the_table(rows["mode"])
        self._commands_are_continuous_and_finite(rows)
        self._power_is_on_only_when_the_servo_wants_it(writes)

    def _torque_only_where_it_belongs(self, rows: Any, writes: Any) -> None:
        drives = TORQUE[rows["mode"]]
        assert np.all(rows["dac"][~drives] == DAC_ZERO)
        assert np.all(np.abs(rows["tau"]) <= PUMA.guard.tau_max)
        torque = writes[(writes[:, 2] != DISCRETE) & (writes[:, 3] != DAC_ZERO)]
        assert np.isin(torque[:, 0], rows["t_ns"][drives]).all()

    def _modes_follow_the_table(self, modes: Any) -> None:
        """FAULT is left by a clear alone, OFF by a request alone."""
        changes = np.flatnonzero(np.diff(modes))
        for before, after in zip(modes[changes], modes[changes + 1], strict=True):
            assert may_follow(before, after), f"{Mode(before).name} -> {Mode(after).name}"
            self.powered_up += after == Mode.POWERING
            self.left_fault += before == Mode.FAULT
        assert self.powered_up <= self.rises
        assert self.left_fault <= self.clears

    def _commands_are_continuous_and_finite(self, rows: Any) -> None:
        for name in ("q_ref", "v_ref", "a_ref", "q", "v", "tau"):
            assert np.all(np.isfinite(rows[name])), name
        driven = np.isin(rows["mode"], [Mode.TRACKING, Mode.STOPPING])
        both = driven[1:] & driven[:-1]
        step = np.abs(np.diff(rows["q_ref"], axis=0))[both]
        assert np.all(step <= 1.3 * PUMA.limits.v_max * self.rig.period_ns * 1e-9 + 1e-9)

    def _power_is_on_only_when_the_servo_wants_it(self, writes: Any) -> None:
        mode = self.rig.mailbox.snapshot().mode
        discrete = writes[writes[:, 2] == DISCRETE, 3]
        if len(discrete):
            assert bool(discrete[-1] & DISCRETE_POWER) == wants_power(mode)
        assert wants_power(mode) or not self.rig.emulator.powered
        estop_open = self.rig.state.image_ok and not self.rig.state.status & STATUS_ESTOP_OK
        assert not (estop_open and wants_power(mode))


TestFaultyArm = FaultyArm.TestCase
TestFaultyArm.settings = settings(max_examples=examples(25), stateful_step_count=15)
