"""Logs by windows: the same rows, ranges and events as of the whole log, whatever became of the file."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from qrobot.errors import LogError
from qrobot.log import windows
from qrobot.log.events import log_events
from qrobot.log.read import read_log
from qrobot.log.record import write_log
from qrobot.log.windows import LogWindows
from qrobot.modecodes import Mode
from tests.support.log_samples import PERIOD_NS, make_header, make_rows

N_ROWS = 30_000
N = 2
PERIOD_S = PERIOD_NS * 1e-9


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A log in several parts, with changes of mode and a fault."""
    rows = make_rows(N_ROWS, N)
    rows["mode"][:100] = Mode.HOLDING
    rows["fault"][20_000:], rows["mode"][20_000:] = 66, Mode.FAULT
    write_log(tmp_path / "run.mcap", rows, make_header(N), max_bytes=1 << 20)
    return tmp_path / "run.mcap"


def opened(path: Path) -> LogWindows:
    log = LogWindows(path)
    while log.read_on():
        pass
    return log


def expected(path: Path) -> np.ndarray:
    rows = read_log(path).rows
    return np.hstack([rows["q_ref"] - rows["q"], rows["q"], rows["q_ref"], rows["v"], rows["tau"]])


def test_events_length_and_rows_are_those_of_the_whole_log(path: Path) -> None:
    log, whole = opened(path), read_log(path)
    assert len(whole.parts) > 1
    assert [(e.kind, e.tick, e.text) for e in log.events] == [(e.kind, e.tick, e.text) for e in log_events(whole)]
    assert [e.t_s for e in log.events] == pytest.approx([e.t_s for e in log_events(whole)])
    assert (log.end_s, log.share, log.whole, log.damaged) == (pytest.approx(whole.time_s[-1]), 1.0, True, 0)
    np.testing.assert_array_equal(log.rows(1.0, 1.01), whole.rows[4000:4041])


@pytest.mark.parametrize("exact_rows", [windows.EXACT_ROWS, 1000])
def test_the_extremes_of_a_long_window_are_none_but_those_of_its_rows(
    path: Path, monkeypatch: pytest.MonkeyPatch, exact_rows: int
) -> None:
    """Row by row, and by what is kept of each chunk."""
    monkeypatch.setattr(windows, "EXACT_ROWS", exact_rows)
    curves, values = opened(path).curves(0.0, 100.0, 300), expected(path)
    assert curves.t_s.size <= 300
    bounds = [*np.rint(curves.t_s / PERIOD_S).astype(int), N_ROWS]
    for k, (begin, end) in enumerate(pairwise(bounds)):
        np.testing.assert_array_equal(curves.low[k], values[begin:end].min(axis=0))
        np.testing.assert_array_equal(curves.high[k], values[begin:end].max(axis=0))
        np.testing.assert_array_equal(curves.first[k], values[begin])


@pytest.mark.parametrize("exact_rows", [windows.EXACT_ROWS, 1000])
def test_what_is_not_known_hides_no_peak_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, exact_rows: int
) -> None:
    monkeypatch.setattr(windows, "EXACT_ROWS", exact_rows)
    rows = make_rows(N_ROWS, N)
    rows["tau"][10_000, 0], rows["tau"][10_003, 0] = 50.0, np.nan
    write_log(tmp_path / "run.mcap", rows, make_header(N))
    curves = opened(tmp_path / "run.mcap").curves(0.0, 100.0, 300)
    assert np.nanmax(curves.high[:, 4 * N]) == 50.0
    assert np.isfinite(curves.low).all()


def test_a_short_window_has_every_row(path: Path) -> None:
    curves = opened(path).curves(5.0, 5.02, 300)
    np.testing.assert_allclose(curves.t_s, 5.0 + PERIOD_S * np.arange(81), atol=1e-9)
    np.testing.assert_array_equal(curves.low, expected(path)[20_000:20_081])


def test_a_cut_or_damaged_log_shows_what_is_whole_and_says_so(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[data.index(b"\x04\x00\x00\x00zstd", len(data) // 3) + 300] ^= 0xFF  # within a chunk
    path.write_bytes(data)
    last = sorted(path.parent.glob("*.mcap"))[-2]
    last.write_bytes(last.read_bytes()[: last.stat().st_size // 2])
    log, whole = opened(path), read_log(path)
    assert (log.damaged, log.whole) == (1, False)
    assert log.end_s == pytest.approx(whole.time_s[-1])
    shown = log.curves(0.0, 100.0, 100)
    values = expected(path)
    np.testing.assert_array_equal(shown.low.min(axis=0), values.min(axis=0))
    np.testing.assert_array_equal(shown.high.max(axis=0), values.max(axis=0))


def test_too_many_rows_at_a_time_an_empty_log_and_no_log_are_told(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(windows, "MOST_EXPORTED", 8000)
    with pytest.raises(LogError, match="show less than 2 s"):
        opened(path).rows(0.0, 10.0)
    write_log(tmp_path / "empty.mcap", make_rows(0, N), make_header(N))
    empty = opened(tmp_path / "empty.mcap")
    assert (empty.curves(0.0, 1.0, 100).t_s.size, empty.rows(0.0, 1.0).size, empty.events) == (0, 0, [])
    (tmp_path / "other.mcap").write_bytes(b"no log")
    for name in ("other.mcap", "none.mcap"):
        with pytest.raises(LogError):
            LogWindows(tmp_path / name)
