"""Self-test of the rate at start: the real loop runs for a moment on memory of its own, before power can be had.

Its telemetry tells what a cycle costs and how late it wakes. A machine that other work holds up for a moment is tried
again: a rate passes with the first window in which it is kept.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from qrobot.faultcodes import FaultCode
from qrobot.realtime.setup import SetupStep
from qrobot.servo.memory.telemetry import Rows
from qrobot.units import NS_PER_S

RATE: Final = int(FaultCode.RATE)
RT_BUDGET: Final = int(FaultCode.RT_BUDGET)
WINDOWS: Final = 4
WINDOW_NS: Final = 500_000_000
SETTLING_ROWS: Final = 20  # in which the spin margin and the caches find themselves
QUANTILE: Final = 0.99
MOST_COST: Final = 0.5  # share of the period, as `timing_checks` warns of a slow cycle
MOST_LATE: Final = 0.01  # share of cycles, as [arm.servo.overrun] has it
MOST_BUDGET: Final = 0.8  # [A] of a processor, whatever the kernel would allow a real-time thread
RATES: Final = (8000.0, 6000.0, 5000.0, 4000.0, 3000.0, 2000.0, 1500.0, 1000.0, 750.0, 500.0, 250.0, 100.0)  # proposed


@dataclass(frozen=True)
class RateTest:
    """Result of a window of cycles.

    Attributes:
        cost_ns: of a cycle, in 99 of 100. late_ns: wake-up error, likewise.
        late_share: of the points of the time grid, those met late by half a period or not at all.
    """

    cost_ns: int
    late_ns: int
    late_share: float

    def keeps(self, period_ns: int) -> bool:
        """The machine keeps cycles of this length."""
        return self.cost_ns <= MOST_COST * period_ns and self.late_share <= MOST_LATE

    def highest_rate(self) -> float | None:
        """The highest of `RATES` whose period leaves room for cost and wake-up error as measured; None for none."""
        shortest_ns = max(self.cost_ns / MOST_COST, 2.0 * self.late_ns)
        return next((rate for rate in RATES if NS_PER_S / rate >= shortest_ns), None)

    def words(self, period_ns: int) -> str:
        """Words for people."""
        cost, late = self.cost_ns / 1e3, self.late_ns / 1e3
        share = f"{self.cost_ns / period_ns:.0%} of the period"
        return f"a cycle takes {cost:.1f} µs ({share}) and wakes {late:.0f} µs late, {self.late_share:.1%} too late"


def pace_of(rows: Rows, period_ns: int) -> RateTest:
    """Judge the telemetry of a window, at least two rows, oldest first."""
    rows = rows[min(SETTLING_ROWS, rows.size - 2) :]
    points = max(1, int(rows["t_ns"][-1] - rows["t_ns"][0]) // period_ns)
    skipped = max(0, points - (rows.size - 1))
    late = int((rows["late_ns"] > period_ns // 2).sum()) + skipped
    cost, late_ns = (int(np.quantile(rows[name], QUANTILE)) for name in ("busy_ns", "late_ns"))
    return RateTest(cost, max(0, late_ns), late / (points + 1))


def best_pace(windows: Iterable[Rows], period_ns: int) -> RateTest | None:
    """The first window in which the rate is kept, else the one least late; None without a window of two rows."""
    best: RateTest | None = None
    for rows in windows:
        if rows.size < 2:
            continue
        pace = pace_of(rows, period_ns)
        if pace.keeps(period_ns):
            return pace
        if best is None or (pace.late_share, pace.cost_ns) < (best.late_share, best.cost_ns):
            best = pace
    return best


def judge_pace(run_window: Callable[[], Rows], rate_hz: float) -> SetupStep:
    """Let the loop run, up to `WINDOWS` times, and say whether the rate is kept; `run_window` gives its telemetry."""
    period_ns = round(NS_PER_S / rate_hz)
    pace = best_pace((run_window() for _ in range(WINDOWS)), period_ns)
    name = "rate"
    if pace is None:
        return SetupStep(name, False, f"{rate_hz:g} Hz: the loop hardly ran", "free the processor of other work")
    detail, fits = f"{rate_hz:g} Hz: {pace.words(period_ns)}", pace.highest_rate()
    if pace.keeps(period_ns):
        return SetupStep(name, True, detail + (f"; there is room for {fits:g} Hz" if fits and fits > rate_hz else ""))
    lower = fits is not None and fits < rate_hz
    advice = f"this machine would keep {fits:g} Hz: lower rate_hz" if lower else "free the processor of other work"
    return SetupStep(name, False, detail, f"{advice}, or sign for your rate_hz with unchecked_rate = true")


def judge_budget(spin_share: float, throttled_to: float | None) -> SetupStep:
    """Say whether the processor time of the loop fits into what the kernel leaves a real-time thread.

    Args:
        spin_share: most of each period in which the loop spins or computes.
        throttled_to: share that the kernel leaves real-time threads of each second; None for no limit.
    """
    allowed = MOST_BUDGET if throttled_to is None else min(MOST_BUDGET, throttled_to - (1.0 - MOST_BUDGET) / 2.0)
    detail = f"the loop needs up to {spin_share:.0%} of its processor, {allowed:.0%} are allowed"
    fits = spin_share <= allowed
    remedy = "lower rate_hz, set spin = false in [arm.servo], or sysctl kernel.sched_rt_runtime_us=950000"
    return SetupStep("processor time", fits, detail, "" if fits else remedy)
