"""Binary outputs of an arm: what each line is called, where it goes, and what becomes of it when the arm stops."""

from __future__ import annotations

from typing import Final, Literal

from pydantic import Field

from qrobot.config.document import Table

N_OUTPUTS: Final = 16  # as many as the wire's STATE has bits for
ALL_OUTPUTS: Final = (1 << N_OUTPUTS) - 1


class OutputLine(Table):
    """Line `output` of the arm, from 1: bit `output` - 1 of what a program says in `chg.outputs`.

    With `on_stop = "off"` it goes off whenever the arm stops otherwise than at the end of a motion, or nobody commands
    it, and comes on again only after its program has let go of it; with "hold" it stays as its program has left it.
    """

    output: int = Field(ge=1, le=N_OUTPUTS)
    name: str = Field(default="", pattern=r"^[a-z][a-z0-9_]*$|^$", max_length=32)
    on_stop: Literal["off", "hold"] = "off"

    @property
    def label(self) -> str:
        """Name of the output for people."""
        return self.name or f"output_{self.output}"


class BoardOutput(OutputLine):
    """One of the board's own lines: bit 3, 4 or 5 of its DISCRETE register, 1 for on.

    A board that is reset shows a 0 there, so wire the line that 0 does no harm. Whether a bit has a driver, on which
    pin and of which polarity, is not published: measure it.
    """

    bit: int = Field(ge=3, le=5)
