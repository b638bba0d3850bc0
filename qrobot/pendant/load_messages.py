"""Messages of a page about what the arm carries, and what follows when it meets something."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from qrobot.pendant.page_message import ArmNumber, PageMessage

MOST_LOAD_KG = 1_000.0  # [A] the servo refuses what its arm cannot carry
MOST_OFF_MM = 1_000.0  # [A]
MOST_BACK_MM = 300.0  # as `Channel.retract` takes
LEAST_SHARE = 0.05  # [A] of the robot file's thresholds: below that friction alone tells collisions

Offset = Annotated[float, Field(ge=-MOST_OFF_MM, le=MOST_OFF_MM, allow_inf_nan=False, strict=False)]
BackMm = Annotated[float, Field(ge=0, le=MOST_BACK_MM, allow_inf_nan=False, strict=False)]


class PageLoad(PageMessage):
    """Let the servo reckon with a load: kg, and its centre of mass in the frame of the flange, mm."""

    do: Literal["load"]
    arm: ArmNumber
    mass: float = Field(ge=0, le=MOST_LOAD_KG, allow_inf_nan=False, strict=False)
    centre_mm: tuple[Offset, Offset, Offset] = Field(strict=False)


class PageCollision(PageMessage):
    """Choose when a collision is told, as a share of the robot file's thresholds, and what follows it."""

    do: Literal["collision"]
    arm: ArmNumber
    share: float = Field(ge=LEAST_SHARE, le=1, allow_inf_nan=False, strict=False)
    reaction: Literal["stop", "comply"]
