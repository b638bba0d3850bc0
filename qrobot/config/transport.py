"""Transports to a board that is not emulated here: one table for each kind, beside `kind` in `[arm.board]`."""

from __future__ import annotations

from pydantic import Field

from qrobot.config.document import Table

LAST_BASE = 0xFFC0  # 64 bytes of ports above it


class PortTransport(Table):
    """A TRC006 card on this machine's ISA bus, reached by the servo's own cycle.

    `base` is the jumpered port address. With `read_only` nothing is written, and what would have been is counted: a dry
    run, in which the arm cannot get power.
    """

    base: int = Field(default=0x300, ge=0x100, le=LAST_BASE, multiple_of=2)
    read_only: bool = False
