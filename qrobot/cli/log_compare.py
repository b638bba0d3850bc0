"""`qrobot log compare`: two logs of one robot side by side."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rich.table import Table

from qrobot.cli.console import note, out, plain_table, print_table, write_json
from qrobot.cli.logs import read_and_warn
from qrobot.cli.option_types import OutputFigure

if TYPE_CHECKING:
    from qrobot.log.compare import JointComparison, LogComparison

MOST_RATIO: Final = 1000.0  # that is told as a number


def compare(a: Path, b: Path, *, plot: OutputFigure | None = None, json: bool = False) -> None:
    """Lay two logs of one robot side by side: tracking errors, punctuality, and what was different about the runs.

    Time counts from the first tracking cycle of each; a further shift, as another interpolation or sample period makes
    it, is found from the desired positions and told. Ratios are b over a: below one, b was better.

    Examples:

      qrobot log compare before.mcap after.mcap
      qrobot log compare before.mcap after.mcap --plot difference.png
      qrobot log compare before.mcap after.mcap --json | jq '.joints[].rms_ratio'

    Parameters
    ----------
    a
        First file of one log.
    b
        First file of the other.
    plot
        Draw positions and errors of both into this file; its suffix chooses the format (.png, .pdf, .svg).
    json
        Print JSON.
    """
    from qrobot.log.compare import compare_logs

    comparison = compare_logs(read_and_warn(a), read_and_warn(b))
    if plot is not None:
        _draw(comparison, plot)
    if json:
        write_json(comparison.to_dict())
        return
    for table in (_errors(comparison), _cycles(comparison), _differences(comparison)):
        print_table(table)
        out.print()


def _draw(comparison: LogComparison, path: Path) -> None:
    from qrobot.log.overlay import comparison_figure
    from qrobot.log.plot import save_figure

    save_figure(comparison_figure(comparison), path)
    note(f"figure {path}")


def _errors(comparison: LogComparison) -> Table:
    late_ms = comparison.shift_s * 1e3
    shift = f"b's motion comes {abs(late_ms):.1f} ms {'later' if late_ms >= 0.0 else 'earlier'}"
    title = f"tracking error, mrad (mm on a sliding joint); {shift}"
    table = plain_table(title, "joint", "max a", "max b", "b/a", "rms a", "rms b", "b/a", "setpoints differ by")
    for joint in comparison.joints:
        table.add_row(joint.name, *_numbers(joint))
    return table


def _numbers(joint: JointComparison) -> list[str]:
    largest, rms = ([f"{error * 1e3:.3f}" for error in pair] for pair in (joint.max_error, joint.rms_error))
    differ = f"{joint.setpoints_differ * 1e3:.3f}"
    return [*largest, _ratio(joint.max_ratio), *rms, _ratio(joint.rms_ratio), differ]


def _ratio(value: float) -> str:
    if math.isnan(value):
        return "-"
    return f"{value:.2f}" if value < MOST_RATIO else f"> {MOST_RATIO:g}"  # of a joint that stood in one of them


def _cycles(comparison: LogComparison) -> Table:
    from qrobot.faultcodes import explain

    table = plain_table("cycles", "", "a", "b")
    both = comparison.summaries
    for what in ("cycles", "tracking_cycles", "dropout_cycles", "late_cycles", "skipped_cycles", "lost_rows"):
        table.add_row(what.replace("_", " "), *(str(getattr(summary, what)) for summary in both))
    for what in ("p50", "p99", "max"):
        table.add_row(f"wake-up {what}, µs", *(f"{getattr(summary.wakeup_us, what):.2f}" for summary in both))
    table.add_row("faults", *("; ".join(explain(code) for code in summary.faults) or "none" for summary in both))
    return table


def _differences(comparison: LogComparison) -> Table:
    table = plain_table(
        "what was different" if comparison.differences else "both say the same of themselves", "", "a", "b"
    )
    for difference in comparison.differences:
        table.add_row(difference.what, _plain(difference.a), _plain(difference.b))
    return table


def _plain(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "-" if value is None or value == "" else str(value)
