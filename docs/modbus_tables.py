"""The Modbus map as tables of its page."""

from __future__ import annotations

from tables import table

from qrobot.hwif.modbus.map import BOARD_ROWS, IMAGE, MAILBOX, ROBOT_ROWS, MapRow


def _rows(rows: tuple[MapRow, ...]) -> str:
    head = ("address", "n", "name", "form", "access", "meaning")
    return table(
        head,
        (
            (str(r.address), str(r.count), r.name, r.form, r.access, r.meaning)
            for r in sorted(rows, key=lambda row: row.address)
        ),
    )


def window() -> str:
    """The board's own registers."""
    return _rows(tuple(row for row in BOARD_ROWS if row.address < IMAGE))


def image() -> str:
    """Image, counters and identity."""
    return _rows(tuple(row for row in BOARD_ROWS if IMAGE <= row.address < MAILBOX))


def mailbox() -> str:
    """The mailbox."""
    return _rows(tuple(row for row in BOARD_ROWS if row.address >= MAILBOX))


def robot() -> str:
    """What a running robot adds."""
    return _rows(ROBOT_ROWS)
