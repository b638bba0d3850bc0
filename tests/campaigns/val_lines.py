"""Spoilt lines of VAL II: each is read, and printed as the same, or refused with line and column."""

from __future__ import annotations

from tests.support.val_lines import spoil_lines

SEED = 106


def campaign(lines: int) -> int:
    """Run it and print what went wrong; the number of lines with which something did."""
    refused, read, wrong = spoil_lines(lines, SEED)
    print(*wrong, f"{refused} refused, {read} read, {len(wrong)} wrong", sep="\n", flush=True)
    return len(wrong)
