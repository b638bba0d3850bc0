"""Reports to people: one line of text at a time, to a function that each part is given."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

Report: TypeAlias = Callable[[str], None]
