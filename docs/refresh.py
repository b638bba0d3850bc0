"""Rewrite the generated parts of the reference pages: `python docs/refresh.py`. Tests refuse a page that is stale."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Final

from qrobot.servo import modes
from qrobot.wire import document

REFERENCE: Final = Path(__file__).parent / "reference"
_DIAGRAM: Final = re.compile(r"(?<=```mermaid\n).*?(?=```)", re.DOTALL)


def refresh_modes(page: str) -> str:
    """The page on modes with its diagram made anew."""
    return _DIAGRAM.sub(modes.mermaid(), page)


PAGES: Final[dict[str, Callable[[str], str]]] = {"wire-protocol.md": document.refresh, "modes.md": refresh_modes}


def main() -> None:
    """Rewrite every page that has generated parts."""
    for name, refresh in PAGES.items():
        page = REFERENCE / name
        page.write_text(refresh(page.read_text()))


if __name__ == "__main__":
    main()
