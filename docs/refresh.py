"""Rewrite the generated parts of the reference pages: `python docs/refresh.py`. A test refuses a page that is stale."""

from __future__ import annotations

from pathlib import Path

from qrobot.wire import document

REFERENCE = Path(__file__).parent / "reference"


def main() -> None:
    page = REFERENCE / "wire-protocol.md"
    page.write_text(document.refresh(page.read_text()))


if __name__ == "__main__":
    main()
