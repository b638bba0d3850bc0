"""Messages of a page about programs."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from qrobot.pendant.page_message import ArmNumber, MovingMessage, PageMessage

ProgramName = Annotated[str, Field(min_length=1, max_length=200)]
RunManner = Literal["offline", "lockstep", "live"]


class PageProgramStart(MovingMessage):
    """Start a program of the folder.

    Attributes:
        execute: program of a VAL file.
        speed: monitor speed of VAL, percent.
        step: leave a VAL program at its first step, for `PageProgramSay` to go on.
        confirmed: the user has said that the arm may move; live programs need it.
        stamp: of the source that the page shows, as `ProgramFolder.listing` tells it; live programs need it.
    """

    do: Literal["program start"]
    arm: ArmNumber
    name: ProgramName
    manner: RunManner
    execute: str = Field(default="main", pattern=r"^[A-Za-z][A-Za-z0-9_.]{0,39}$")
    speed: float = Field(default=50.0, ge=0.1, le=100.0, allow_inf_nan=False, strict=False)
    step: bool = False
    confirmed: bool = False
    stamp: str = Field(default="", max_length=20)


class PageProgramEnd(PageMessage):
    """End the program that runs. Any page may."""

    do: Literal["program end"]
    arm: ArmNumber


class PageProgramInterrupt(PageMessage):
    """Interrupt a VAL program that is stepped: it can be gone on with."""

    do: Literal["program interrupt"]
    arm: ArmNumber


class PageProgramSay(MovingMessage):
    """A line for the input of the program."""

    do: Literal["program say"]
    arm: ArmNumber
    line: str = Field(max_length=200, pattern=r"^[^\r\n\x00-\x1f]*$")
