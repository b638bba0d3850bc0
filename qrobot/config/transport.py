"""Transports to a board that is not emulated here: one table for each kind, beside `kind` in `[arm.board]`."""

from __future__ import annotations

from pydantic import Field

from qrobot.config.document import Table

PORTS = 64  # of a card, from its base on
LAST_BASE = 0x10000 - PORTS


class PortTransport(Table):
    """A TRC006 card on this machine's ISA bus, reached by the servo's own cycle.

    `base` is the jumpered port address. With `read_only` nothing is written, and what would have been is counted: a dry
    run, in which the arm cannot get power.
    """

    base: int = Field(default=0x300, ge=0x100, le=LAST_BASE, multiple_of=2)
    read_only: bool = False

    @property
    def places(self) -> frozenset[str]:
        """Port addresses of the card."""
        return frozenset(f"port 0x{self.base + k:x}" for k in range(PORTS))
