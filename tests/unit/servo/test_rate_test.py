"""The self-test of the rate: judged by what its cycles show, on any machine, and never by one stall."""

from __future__ import annotations

import mmap
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.errors import ConfigError, QRobotError
from qrobot.realtime.machine import throttled_to
from qrobot.realtime.page_faults import FaultWatch, page_faults
from qrobot.servo.memory.telemetry import Rows, TelemetryLayout, fitting_capacity, ring_words
from qrobot.servo.process.daemon import ServoProcess
from qrobot.servo.process.loop import MARGIN_MAX_NS, longest_margin
from qrobot.servo.process.rate_test import MOST_COST, RATES, SETTLING_ROWS, judge_budget, judge_pace, pace_of
from qrobot.servo.settings import COUNTED_ONLY, ServoSettings

PERIOD_NS = 1_000_000


def window(rows: int = 500, cost_ns: int = 20_000, late_ns: int = 5_000, skipped: tuple[int, ...] = ()) -> Rows:
    """Telemetry of a window; the cycles in `skipped` never ran."""
    out = TelemetryLayout(1).empty(rows)
    out["t_ns"] = np.arange(rows) * PERIOD_NS
    out["busy_ns"], out["late_ns"] = cost_ns, late_ns
    return np.delete(out, skipped)


def test_a_machine_that_keeps_the_rate_passes_with_its_first_window() -> None:
    asked: list[int] = []
    step = judge_pace(lambda: asked.append(1) or window(), 1000.0)  # type: ignore[func-returns-value]
    assert step.ok
    assert len(asked) == 1
    assert "20.0 µs (2% of the period)" in step.detail


@pytest.mark.parametrize(
    ("share", "ok"), [(0.0, 1), (MOST_COST - 1e-3, 1), (MOST_COST, 1), (MOST_COST + 1e-3, 0), (3.0, 0)]
)
def test_a_cycle_may_cost_half_its_period(share: float, ok: int) -> None:
    assert judge_pace(lambda: window(cost_ns=int(share * PERIOD_NS)), 1000.0).ok == bool(ok)


@pytest.mark.parametrize(("missing", "ok"), [(0, 1), (5, 1), (6, 0), (50, 0)])
def test_one_cycle_in_a_hundred_may_be_skipped_or_late(missing: int, ok: int) -> None:
    first = SETTLING_ROWS + 10
    gone = window(rows=500 + SETTLING_ROWS, skipped=tuple(range(first, first + missing)))
    assert judge_pace(lambda: gone, 1000.0).ok == bool(ok)
    late = window(rows=500 + SETTLING_ROWS)
    late["late_ns"][first : first + missing] = PERIOD_NS // 2 + 1
    assert judge_pace(lambda: late, 1000.0).ok == bool(ok)


def test_three_windows_may_stall() -> None:
    def windows() -> Iterator[Rows]:
        yield from [window(late_ns=PERIOD_NS)] * 3
        yield window()

    run = windows()
    assert judge_pace(lambda: next(run), 1000.0).ok


@given(cost_ns=st.integers(0, 10_000_000), late_ns=st.integers(0, 10_000_000))
def test_the_rate_that_is_proposed_would_have_been_kept(cost_ns: int, late_ns: int) -> None:
    pace = pace_of(window(cost_ns=cost_ns, late_ns=late_ns), PERIOD_NS)
    proposed = pace.highest_rate()
    if proposed in RATES:
        assert cost_ns <= MOST_COST * 1e9 / proposed
        assert 2 * late_ns <= 1e9 / proposed
    else:
        assert cost_ns > MOST_COST * 1e9 / RATES[-1] or 2 * late_ns > 1e9 / RATES[-1]


def test_a_rate_that_is_not_kept_is_told_with_one_that_would_be() -> None:
    step = judge_pace(lambda: window(cost_ns=700_000), 1000.0)
    assert not step.ok
    assert "this machine would keep 500 Hz" in step.remedy
    assert not judge_pace(lambda: window(rows=1), 1000.0).ok
    assert "would keep" not in judge_pace(lambda: window(cost_ns=9_000_000), 1000.0).remedy  # no file may have 50 Hz


@pytest.mark.parametrize("rate_hz", [0.0, -1.0, 49.0, 10_001.0, 20_000.0, 1e9, np.nan, np.inf])
def test_absurd_rates_are_refused_with_the_range(rate_hz: float) -> None:
    with pytest.raises(ConfigError, match=r"^RATE: .*allowed are 50 to 10000 Hz"):
        ServoSettings(rate_hz=rate_hz)


@pytest.mark.parametrize(
    ("share", "throttled", "fits"),
    [(0.6, None, 1), (0.8, None, 1), (0.81, None, 0), (0.8, 0.95, 1), (0.6, 0.7, 1), (0.6, 0.65, 0), (0.2, 0.0, 0)],
)
def test_the_loop_stays_below_what_the_kernel_leaves_it(share: float, throttled: float | None, fits: int) -> None:
    assert judge_budget(share, throttled).ok == bool(fits)


@pytest.mark.parametrize("rate_hz", [50, 1000, 4000, 10_000])
def test_the_loop_never_spins_more_than_its_budget(rate_hz: int) -> None:
    period_ns = 10**9 // rate_hz
    margin = longest_margin(period_ns)
    assert 0 < margin <= MARGIN_MAX_NS
    assert judge_budget(margin / period_ns, 0.95).ok


def test_what_the_kernel_leaves_is_read(tmp_path: Path) -> None:
    assert throttled_to(tmp_path) is None
    folder = tmp_path / "proc/sys/kernel"
    folder.mkdir(parents=True)
    (folder / "sched_rt_period_us").write_text("1000000\n")
    (folder / "sched_rt_runtime_us").write_text("500000\n")
    assert throttled_to(tmp_path) == 0.5
    (folder / "sched_rt_runtime_us").write_text("-1\n")
    assert throttled_to(tmp_path) is None


def test_page_faults_of_a_thread_are_counted_from_when_it_is_ready(tmp_path: Path) -> None:
    def write(minor: int, major: int) -> None:
        (tmp_path / "7").mkdir(exist_ok=True)
        (tmp_path / "7/stat").write_text(f"7 (a ) name) S 1 2 3 4 5 6 {minor} 99 {major} 98 0 0\n")

    watch = FaultWatch(tmp_path)
    assert watch.look() == 0
    write(100, 3)
    watch.begin(7)
    assert (watch.look(), watch.count) == (0, 0)
    write(104, 4)
    assert (watch.look(), watch.look(), watch.count) == (5, 0, 5)
    (tmp_path / "7/stat").write_text("7 (gone")
    assert (watch.look(), watch.count) == (0, 5)
    assert page_faults(8, tmp_path) is None


def test_a_thread_that_touches_new_memory_has_page_faults() -> None:
    own = threading.get_native_id()
    before = page_faults(own)
    with mmap.mmap(-1, 1 << 25) as fresh:  # 32 MB that nobody had before: thousands of pages, or some dozen large ones
        fresh[:: mmap.PAGESIZE] = bytes(len(fresh) // mmap.PAGESIZE)
    after = page_faults(own)
    assert before is not None
    assert after is not None
    assert after > before


@pytest.mark.parametrize(("rate_hz", "rows"), [(1000.0, 1 << 16), (4000.0, 1 << 18), (10_000.0, 1 << 20)])
def test_the_black_box_holds_a_minute_at_every_rate(rate_hz: float, rows: int) -> None:
    settings = ServoSettings(rate_hz=rate_hz)
    assert settings.telemetry_capacity == rows
    assert 60.0 <= rows / rate_hz < 120.0


@given(free=st.integers(0, 1 << 32), seconds=st.floats(1.0, 600.0), rate_hz=st.floats(50.0, 10_000.0))
def test_the_ring_takes_half_of_the_room_at_most_and_no_less_than_it_could(
    free: int, seconds: float, rate_hz: float
) -> None:
    wanted, row_words = ServoSettings(rate_hz=rate_hz, black_box_s=seconds).telemetry_capacity, 56
    rows = fitting_capacity(row_words, wanted, free)
    assert rows & (rows - 1) == 0
    assert rows <= wanted
    assert rows == 16 or 16 * ring_words(row_words, rows) <= free
    assert rows == wanted or 16 * ring_words(row_words, 2 * rows) > free


def starting(require_realtime: bool = False, fifo: bool = False, **choices: object) -> SimpleNamespace:
    """A servo process whose cycles take nine tenths of their period, as far as the self-test looks at it."""
    said: list[str] = []
    return SimpleNamespace(
        settings=ServoSettings(**choices),  # type: ignore[arg-type]
        steps=(),
        said=said,
        report=said.append,
        require_realtime=require_realtime,
        _has_fifo=lambda: fifo,
        _spin_share=lambda: 0.95,
    )


def slow_window() -> Rows:
    """Telemetry of cycles that take nine tenths of their period."""
    return window(cost_ns=900_000)


@pytest.mark.parametrize(
    "choices", [{}, {"overrun": COUNTED_ONLY}, {"emulated": True, "overrun": COUNTED_ONLY, "require_realtime": True}]
)
def test_a_real_board_or_whoever_requires_real_time_gets_no_loop_that_is_too_slow(choices: dict[str, object]) -> None:
    with pytest.raises(QRobotError, match=r"^RATE: 1000 Hz: .*this machine would keep 500 Hz"):
        ServoProcess._insist_on_the_rate(starting(**choices), slow_window)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "choices", [{"emulated": True, "overrun": COUNTED_ONLY}, {"emulated": True}, {"unchecked_rate": True}]
)
def test_an_emulated_arm_and_whoever_signs_are_told(choices: dict[str, object]) -> None:
    process = starting(**choices)  # type: ignore[arg-type]
    ServoProcess._insist_on_the_rate(process, slow_window)  # type: ignore[arg-type]
    assert [line[:5] for line in process.said] == ["RATE:"]
    assert [(step.name, step.ok) for step in process.steps] == [("rate", False)]


def test_a_loop_that_spins_more_than_its_share_is_refused_under_a_real_time_scheduler_only() -> None:
    process = starting(fifo=True)
    with pytest.raises(QRobotError, match=r"^RT_BUDGET: .*sched_rt_runtime_us"):
        ServoProcess._insist_on_the_rate(process, window)  # type: ignore[arg-type]
    process._has_fifo = lambda: False
    ServoProcess._insist_on_the_rate(process, window)  # type: ignore[arg-type]


@pytest.mark.parametrize(("own", "trial", "newest"), [(0, None, 0), (0, 7, 7), (9, 7, 9)])
def test_cycles_of_the_self_test_are_cycles_of_the_loop(own: int, trial: int | None, newest: int) -> None:
    """Otherwise the loop would lose its priority for standing still."""
    front = SimpleNamespace(heartbeat=SimpleNamespace(t_ns=own))
    tried = None if trial is None else SimpleNamespace(beat_ns=trial)
    process = SimpleNamespace(memory=SimpleNamespace(front=front), trial=tried)
    assert ServoProcess.beat_ns.__get__(process) == newest
