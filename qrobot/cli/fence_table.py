"""The fences of a running servo as a table: what each keeps the arm out of or inside, and how far off it is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from rich.table import Table

from qrobot.cli.console import plain_table
from qrobot.servo.operator.messages import FenceStatus
from qrobot.units import MM_PER_M

PARTS: Final = {"all": "all of the arm", "links": "each link", "tool": "the tool"}
BODIES: Final = {"box": "a box", "cylinder": "a cylinder", "plane": "what is behind a plane"}


def fence_table(fences: Sequence[FenceStatus]) -> Table:
    """A row for each fence, the nearest to its margin first."""
    headings = ("fence", "what", "nearest part", "off (mm)", "margin (mm)", "")
    table = plain_table("", *headings, words=("what", "nearest part", ""))
    for fence in sorted(fences, key=lambda each: each.distance_m - each.margin_m):
        numbers = (f"{fence.distance_m * MM_PER_M:.0f}", f"{fence.margin_m * MM_PER_M:g}")
        table.add_row(fence.name, _what(fence), fence.body, *numbers, _note(fence))
    return table


def _what(fence: FenceStatus) -> str:
    if fence.shape == "capsules":
        return "parts of the arm keep apart"
    verb = "stays in" if fence.keep == "in" else "keeps out of"
    return f"{PARTS[fence.bodies]} {verb} {BODIES[fence.shape]}"


def _note(fence: FenceStatus) -> str:
    if fence.distance_m < 0:
        return "ENTERED: motions may leave, and go no deeper"
    return "within the margin: motions may leave, and come no nearer" if fence.distance_m < fence.margin_m else ""
