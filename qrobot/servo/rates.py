"""Cycle rates that a servo may be asked for; whether a machine keeps one is found out at start."""

from __future__ import annotations

from typing import Final

LOWEST_RATE_HZ: Final = 50.0  # [A]
HIGHEST_RATE_HZ: Final = 10_000.0  # [A]
