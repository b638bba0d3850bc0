"""The form of every message of a page."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

ArmNumber = Annotated[int, Field(ge=0, le=31)]


class PageMessage(BaseModel):
    """A closed, frozen JSON object."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class MovingMessage(PageMessage):
    """One that may move the arm, and does not count when it comes late, see `ArmStation.is_late`.

    Attributes:
        heard_s: time of the newest sample of the arm at the page, s on the servo's clock; None when it has none.
    """

    heard_s: float | None = Field(default=None, allow_inf_nan=False)
