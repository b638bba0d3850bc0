"""Messages of a page about the board: what is worked and broken, on an emulated one."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from qrobot.pendant.page_message import ArmNumber, PageMessage

BoardLine = Annotated[str, Field(min_length=1, max_length=100, pattern=r"^[a-z][\x20-\x7e]*$")]


class PageBoardForce(PageMessage):
    """Work the panel of the emulated board, a line of `qrobot board force`."""

    do: Literal["board force"]
    arm: ArmNumber
    line: BoardLine


class PageBoardInject(PageMessage):
    """Let something break in the emulated board, a line of `qrobot inject`."""

    do: Literal["board inject"]
    arm: ArmNumber
    line: BoardLine


class PageBoardRepair(PageMessage):
    """Repair everything that was broken."""

    do: Literal["board repair"]
    arm: ArmNumber
