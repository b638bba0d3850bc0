"""The tables of `qrobot study`, one view for each kind of study."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from rich.table import Table

from qrobot.cli.console import plain_table
from qrobot.ident.friction import FRICTION_NAMES
from qrobot.study.gain_figure import gain_figure
from qrobot.study.gain_summary import QUIET, GainSummary, PairSummary, summarise_gains
from qrobot.study.identification_figure import identification_figure
from qrobot.study.identification_summary import IdentificationSummary, quantiles, summarise_identification
from qrobot.study.results import Results


@dataclass(frozen=True)
class View:
    """Tables and words by which a kind of study is shown."""

    summarise: Callable[[Results], Any]
    tables: Callable[[Any], Iterator[Table]]
    lines: Callable[[Any], Iterator[str]]
    figure: Callable[[Any], Figure]


def identification_tables(summary: IdentificationSummary) -> Iterator[Table]:
    """Errors by joint, and over all arms."""
    title = f"{len(summary.seeds)} arms: rms error of gravity, N·m (N), and error of friction, %"
    heads = ("joint", "robot file", "median", "95 %", "worst", *(name.replace("_", " ") for name in FRICTION_NAMES))
    table = plain_table(title, *heads)
    gravity, before = quantiles(summary.gravity), quantiles(summary.gravity_before)["median"]
    friction = 100.0 * np.abs(summary.friction_error).max(axis=0)
    for j, joint in enumerate(summary.joints):
        found = (f"{gravity[name][j]:.3f}" for name in ("median", "p95", "worst"))
        table.add_row(joint, f"{before[j]:.2f}", *found, *(f"{error:.1f}" for error in friction[j]))
    yield table


def identification_lines(summary: IdentificationSummary) -> Iterator[str]:
    """Sentences on intervals, friction and tracking."""
    plain = summary.to_dict()
    yield f"{100.0 * plain['inside_95']:.1f} % of the true values are inside their 95 % intervals"
    yield f"{100.0 * plain['friction_within_a_tenth']:.1f} % of the friction values are within 10 % of the truth"
    if summary.inertia:
        yield from _inertia_lines(plain["inertia"], summary.joints)
    if summary.tracking:
        gain, over = plain["tracking"]["gain"], plain["tracking"]["over_exact"]
        yield f"tracking: {gain['median']:.1f} times better than before in the median, {gain['worst']:.1f} at worst"
        yield f"          {over['median']:.2f} times the error of the exact model, {over['worst']:.2f} at worst"


def _inertia_lines(told: dict[str, Any], joints: tuple[str, ...]) -> Iterator[str]:
    before, after = (told[name]["median"] for name in ("before", "after"))
    each = (f"{name} {found:.2f} ({file:.2f})" for name, found, file in zip(joints, after, before, strict=True))
    yield f"torque of fast runs held back, N·m (N), with the file's inertia in brackets, median: {', '.join(each)}"
    if told["inside_95"] is not None:
        yield f"{100.0 * told['inside_95']:.1f} % of the true inertias are inside their 95 % intervals"


def gain_tables(summary: GainSummary) -> Iterator[Table]:
    """A row for each pair of gains."""
    title = f"{summary.arms} arms: errors in % of what the guard allows, chatter in % of the torque limit per cycle"
    heads = ("bandwidth", "damping", "rms", "worst arm", "largest", "worst arm", "chatter", "worst arm", "stopped")
    table = plain_table(title, *heads)
    for pair in summary.pairs:
        table.add_row(*_pair_row(pair), style="bold" if pair is summary.best else None)
    yield table


def _pair_row(pair: PairSummary) -> Iterator[str]:
    plain = pair.to_dict()
    yield from (f"{pair.bandwidth:g}", f"{pair.damping:g}")
    for measure in ("rms", "largest", "chatter"):
        numbers = plain[measure]
        yield from ("-", "-") if numbers is None else (f"{100.0 * numbers[of]:.2f}" for of in ("median", "worst"))
    yield ", ".join(f"{count} by {name}" for name, count in pair.faults.items()) or "none"


def gain_lines(summary: GainSummary) -> Iterator[str]:
    """Lines that propose a pair of gains."""
    best = summary.best
    if best is None:
        yield "every pair made the servo stop some arm: try a smaller bandwidth"
        return
    rule = f"least error of the worst arm, with at most {QUIET:g} times the least chatter"
    yield f"{rule}: bandwidth × {best.bandwidth:g}, damping × {best.damping:g}"


VIEWS: Final = {
    "identification": View(
        summarise_identification, identification_tables, identification_lines, identification_figure
    ),
    "gains": View(summarise_gains, gain_tables, gain_lines, gain_figure),
}
