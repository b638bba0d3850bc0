"""How a part of the program tells people what happens: one line of text at a time, to whoever it was given."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

Report: TypeAlias = Callable[[str], None]
