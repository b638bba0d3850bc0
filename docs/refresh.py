"""Rewrite the generated parts of the pages, the EDS file and the C header. Tests refuse one that is stale.

Run `python docs/refresh.py`. A part stands in its page between `<!-- generated: name -->` and `<!-- end -->`.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

DOCS: Final = Path(__file__).parent
sys.path.insert(0, str(DOCS))

import command_line  # noqa: E402 (found through the line above)
import fault_facts  # noqa: E402
import file_keys  # noqa: E402
import modbus_tables  # noqa: E402
import notebook  # noqa: E402
import tables  # noqa: E402
import wire_header  # noqa: E402

from qrobot.hwif import registers  # noqa: E402
from qrobot.hwif.canbus import objects  # noqa: E402
from qrobot.wire import document  # noqa: E402

PARTS: Final[dict[str, Callable[[], str]]] = {
    "faults": tables.faults,
    "reactions": fault_facts.reactions,
    "breakable": tables.breakable,
    "modes": tables.mode_diagram,
    "phases": tables.phase_diagram,
    "laws": tables.laws,
    "telemetry": tables.telemetry,
    "command-line": command_line.command_line,
    "deployment-keys": file_keys.deployment_keys,
    "robot-keys": file_keys.robot_keys,
    "registers": registers.markdown_table,
    "modbus-window": modbus_tables.window,
    "modbus-image": modbus_tables.image,
    "modbus-mailbox": modbus_tables.mailbox,
    "modbus-robot": modbus_tables.robot,
    "can-objects": objects.objects_page,
}
_PART: Final = re.compile(r"(<!-- generated: ([a-z-]+) -->\n).*?(<!-- end -->)", re.DOTALL)


def rewrite(page: str) -> str:
    """The page with every generated part made anew. Raises KeyError for a part nobody generates."""
    return _PART.sub(lambda found: f"{found[1]}\n{PARTS[found[2]]().strip()}\n\n{found[3]}", page)


PAGES: Final[dict[str, Callable[[str], str]]] = {
    "reference/wire-protocol.md": document.refresh,
    "reference/modes.md": rewrite,
    "reference/faults.md": rewrite,
    "reference/command-line.md": rewrite,
    "reference/deployment-file.md": rewrite,
    "reference/robot-file.md": rewrite,
    "reference/laws.md": rewrite,
    "reference/registers.md": rewrite,
    "reference/modbus-map.md": rewrite,
    "reference/telemetry.md": rewrite,
    "reference/can-objects.md": rewrite,
    "../config/can/qrobot_board.eds": lambda _page: objects.eds_text(),
    "../examples/14_identify.ipynb": lambda _page: notebook.notebook("14_identify.py"),
    "../qrobot/wire/c/qrobot_wire.h": wire_header.refresh,
    "explanation/safety.md": rewrite,
    "explanation/one-move.md": rewrite,
    "how-to/inject-faults.md": rewrite,
}


def main() -> None:
    """Rewrite every page that has generated parts."""
    for name, refresh in PAGES.items():
        page = DOCS / name
        page.write_text(refresh(page.read_text()))


if __name__ == "__main__":
    main()
