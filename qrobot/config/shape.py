"""The body of an arm as capsules: a rod with round ends for each part of a link, thick enough to contain it."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from qrobot.config.document import Section, Table
from qrobot.config.values import GivenName

MOST_CAPSULES = 24  # [A] of an arm with its tool: what the table of the servo has room for

Coordinate = Annotated[float, Field(ge=-5, le=5, allow_inf_nan=False)]
LinkPoint = tuple[Coordinate, Coordinate, Coordinate]
Pair = Annotated[tuple[str, str], Field(strict=False)]
Radius = Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)]


class Capsule(Table):
    """All points within `radius_m` of a straight line from `from_m` to `to_m`, in the frame of a link.

    `link` 0 is the base, n the last one. Both ends at one place make a ball.
    """

    name: GivenName
    link: int = Field(ge=0)
    from_m: LinkPoint = Field(strict=False)
    to_m: LinkPoint = Field(strict=False)
    radius_m: Radius


class Shape(Section):
    """Capsules that contain the arm, for fences. Needed only where a deployment has fences.

    `apart` names pairs of capsules that are looked at for self-collision; neighbours touch all the time.
    """

    capsules: tuple[Capsule, ...] = Field(strict=False, min_length=1, max_length=MOST_CAPSULES - 1)
    apart: tuple[Pair, ...] = Field(default=(), strict=False)

    @model_validator(mode="after")
    def _names_what_there_is(self) -> Shape:
        names = [capsule.name for capsule in self.capsules]
        if twice := [name for name in names if names.count(name) > 1]:
            raise ValueError(f"two capsules have the same name {twice[0]}")
        for pair in self.apart:
            if unknown := [name for name in pair if name not in names]:
                raise ValueError(f"apart names {unknown[0]!r}, which is none of {', '.join(names)}")
            if pair[0] == pair[1]:
                raise ValueError(f"apart names {pair[0]!r} twice in one pair")
        return self
