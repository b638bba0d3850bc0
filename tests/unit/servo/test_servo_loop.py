"""The real-time loop on a clock of its own: which points of the grid it runs at, whatever keeps it from running."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import pytest

from qrobot.hwif.isa.card import NO_CARD, make_card
from qrobot.servo.process import loop

PERIOD_NS = 1_000_000
STALL_NS = 300_000_000
CYCLES, STALLED = 20, 7


class Machine:
    """A machine with one servo and one emulated board, which stands still inside one cycle of the servo.

    Args:
        asleep_ns: so long is the servo held up instead, alone and while it sleeps, before that cycle.
        once_judged: the machine stands still just before that cycle instead, once the servo has asked for the time.

    Attributes:
        now_ns, slipped_ns: the wall's clock, and how far the board lets the arm's time lie behind it.
        cycles: arm's time at which each cycle began.
        told: time and lateness that each cycle was given, ns, and what had been skipped before it.
    """

    def __init__(self, asleep_ns: int = 0, once_judged: bool = False) -> None:
        self.now_ns, self.slipped_ns, self.asleep_ns = 0, 0, asleep_ns
        self.stall_once_judged_ns = STALL_NS if once_judged else 0
        self.stall_inside_ns = 0 if asleep_ns or once_judged else STALL_NS
        self.cycles: list[int] = []
        self.told: list[tuple[int, int, int]] = []
        self.command = SimpleNamespace(shutdown=0)
        self.heartbeat = SimpleNamespace(slipped_ns=0)
        self.state = SimpleNamespace(busy_ns=0, image_ok=1, mode=0, late_cycles=0, skipped_ns=0)
        self.busy: list[int] = []

    def wait_until(self, deadline_ns: int, _margin_ns: int, _most_ns: int) -> int:
        held_up = len(self.cycles) == STALLED - 1
        self.now_ns = max(self.now_ns, deadline_ns) + (self.asleep_ns if held_up else 0)
        return 0

    def await_board(self, _board: Any, _slips: int, due_ns: int) -> tuple[int, int]:
        """The board lets all but a millisecond slip of what it was kept from running, unless it was awake."""
        behind_ns = self.now_ns - self.slipped_ns - due_ns
        if behind_ns > 3 * PERIOD_NS and not self.asleep_ns:
            self.slipped_ns += behind_ns - PERIOD_NS
        told = self.slipped_ns, self.now_ns - self.slipped_ns
        if len(self.cycles) == STALLED - 1:
            self.now_ns, self.stall_once_judged_ns = self.now_ns + self.stall_once_judged_ns, 0
        return told

    def one_cycle(self, *arguments: Any) -> None:
        self.busy.append(self.state.busy_ns)
        self.cycles.append(self.now_ns - self.slipped_ns)
        self.told.append((*arguments[-2:], self.state.skipped_ns))
        self.now_ns += (self.stall_inside_ns if len(self.cycles) == STALLED else 0) or PERIOD_NS // 10
        self.command.shutdown = int(len(self.cycles) == CYCLES)


def run_on(machine: Machine, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("wait_until", "await_board", "one_cycle"):
        monkeypatch.setattr(loop, name, getattr(machine, name))
    monkeypatch.setattr(loop, "monotonic_ns", lambda: machine.now_ns)
    monkeypatch.setattr(loop, "slipped_ns", lambda *_: machine.slipped_ns)
    monkeypatch.setattr(loop, "thread_time", lambda: (0, 0))
    monkeypatch.setattr(loop, "load_acquire", getattr)
    monkeypatch.setattr(loop, "wants_power", lambda _: False)
    monkeypatch.setattr(loop, "stands_down", lambda *_: True)
    params = SimpleNamespace(period_ns=PERIOD_NS, board_slips=1)
    loop.run.py_func(params, machine.state, machine, None, None, make_card(NO_CARD), 0, 10**12)
    assert len(machine.cycles) == CYCLES


def test_a_machine_that_stands_still_inside_a_cycle_runs_the_next_one_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    machine = Machine()
    run_on(machine, monkeypatch)
    apart = [later - sooner for sooner, later in pairwise(machine.cycles)]
    assert max(apart) <= 2 * PERIOD_NS  # of the arm's time
    assert max(machine.busy) <= 2 * PERIOD_NS  # what slipped is no time of the law's
    assert machine.heartbeat.slipped_ns == machine.slipped_ns > STALL_NS - 2 * PERIOD_NS


def test_a_machine_that_stands_still_once_a_cycle_knows_its_time_takes_it_into_no_future(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    machine = Machine(once_judged=True)
    run_on(machine, monkeypatch)
    times = [now_ns for now_ns, _, _ in machine.told]
    apart = [later - sooner for sooner, later in pairwise(times)]
    assert max(apart) <= 2 * PERIOD_NS
    assert machine.slipped_ns > STALL_NS - 2 * PERIOD_NS


@pytest.mark.parametrize("asleep_ns", [PERIOD_NS // 3, PERIOD_NS, 24_300_000, STALL_NS + 1])
def test_a_servo_held_up_alone_runs_its_cycle_for_the_newest_point_of_the_grid(
    asleep_ns: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its image is of now: with the setpoint of when it was due, a joint at speed seems to be far ahead of it."""
    machine = Machine(asleep_ns)
    run_on(machine, monkeypatch)
    late = STALLED - 1
    for k, (began_ns, (now_ns, late_ns, skipped_ns)) in enumerate(zip(machine.cycles, machine.told, strict=True)):
        assert (now_ns - machine.told[0][0]) % PERIOD_NS == 0
        assert began_ns == now_ns + late_ns
        assert 0 <= late_ns < PERIOD_NS
        assert late_ns + skipped_ns == (asleep_ns if k == late else 0)
    assert machine.state.late_cycles == asleep_ns // PERIOD_NS
