"""The form of every message of a page."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

ArmNumber = Annotated[int, Field(ge=0, le=31)]


class PageMessage(BaseModel):
    """A closed, frozen JSON object."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)
