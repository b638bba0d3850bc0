"""Text that came from elsewhere, made safe to print: a terminal obeys control characters, a log is read by lines."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from typing import Final

REPLACEMENT: Final = "?"
# Unicode 15: C0 and C1 controls and DEL (category Cc); separators of lines and paragraphs, and what turns the direction
# of writing round (UAX 9). The same ranges stand in qrw_is_control of qrobot_wire.h.
CONTROL_RANGES: Final = ((0x00, 0x1F), (0x7F, 0x9F), (0x2028, 0x202E), (0x2066, 0x2069))
_CONTROLS: Final = {code: REPLACEMENT for first, last in CONTROL_RANGES for code in range(first, last + 1)}


def printable(text: str) -> str:
    """`text` in one line, each control character replaced by a question mark."""
    return text.translate(_CONTROLS)


def csv_line(cells: Iterable[str]) -> str:
    """One line of CSV, without its end; cells with a comma or a quote are quoted (RFC 4180)."""
    line = io.StringIO()
    csv.writer(line, lineterminator="").writerow(cells)
    return line.getvalue()
