"""Messages of a page about calibration and identification."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from qrobot.pendant.page_message import ArmNumber, MovingMessage, PageMessage

ProcedureStep = Literal["calibrate", "plan", "record lockstep", "record live", "fit"]


class PageProcedureStart(MovingMessage):
    """Begin a step.

    Attributes:
        indexes: index pulses of each joint that a calibration takes.
        slow: a plan with passes near standstill besides.
        confirmed: the user has said that the arm may move; steps that move it need that.
    """

    do: Literal["procedure start"]
    arm: ArmNumber
    step: ProcedureStep
    indexes: int = Field(default=5, ge=3, le=14)
    slow: bool = False
    confirmed: bool = False


class PageProcedureEnd(PageMessage):
    """End the step that runs. Any page may."""

    do: Literal["procedure end"]
    arm: ArmNumber


class PageProcedureKeep(PageMessage):
    """Write the model that was found to its place."""

    do: Literal["procedure keep"]
    arm: ArmNumber
    confirmed: bool = False
