"""The real-time loop on a clock of its own: which points of the grid it runs at, whatever keeps it from running."""

from __future__ import annotations

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

    Attributes:
        now_ns, slipped_ns: the wall's clock, and how far the board lets the arm's time lie behind it.
        cycles: arm's time at which each cycle began.
    """

    def __init__(self) -> None:
        self.now_ns, self.slipped_ns = 0, 0
        self.cycles: list[int] = []
        self.command = SimpleNamespace(shutdown=0)
        self.heartbeat = SimpleNamespace(slipped_ns=0)
        self.state = SimpleNamespace(busy_ns=0, image_ok=1, mode=0, late_cycles=0)
        self.busy: list[int] = []

    def wait_until(self, deadline_ns: int, _margin_ns: int, _most_ns: int) -> int:
        self.now_ns = max(self.now_ns, deadline_ns)
        return 0

    def await_board(self, _board: Any, _slips: int, due_ns: int) -> int:
        """The board lets all but a millisecond slip of what it was kept from running."""
        if (behind_ns := self.now_ns - self.slipped_ns - due_ns) > 3 * PERIOD_NS:
            self.slipped_ns += behind_ns - PERIOD_NS
        return self.slipped_ns

    def one_cycle(self, *_: Any) -> None:
        self.busy.append(self.state.busy_ns)
        self.cycles.append(self.now_ns - self.slipped_ns)
        self.now_ns += STALL_NS if len(self.cycles) == STALLED else PERIOD_NS // 10
        self.command.shutdown = int(len(self.cycles) == CYCLES)


def test_a_machine_that_stands_still_inside_a_cycle_runs_the_next_one_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    machine = Machine()
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
    apart = [later - sooner for sooner, later in zip(machine.cycles, machine.cycles[1:], strict=False)]
    assert len(machine.cycles) == CYCLES
    assert max(apart) <= 2 * PERIOD_NS  # of the arm's time
    assert max(machine.busy) <= 2 * PERIOD_NS  # what slipped is no time of the law's
    assert machine.heartbeat.slipped_ns == machine.slipped_ns > STALL_NS - 2 * PERIOD_NS
