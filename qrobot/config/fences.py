"""Fences of an arm: bodies it keeps out of, or inside which it stays."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from qrobot.config.document import Table
from qrobot.config.scene import Place
from qrobot.config.values import GivenName

MOST_SHAPES = 32  # [A] with those of the scene: what the table of the servo has room for

MOST_OTHER_ARMS = 4  # [A] that one arm keeps off

FenceShape = Literal["box", "cylinder", "plane"]
Bodies = Literal["all", "links", "tool"]
Angle = Annotated[float, Field(ge=-360, le=360, allow_inf_nan=False)]
Size = Annotated[float, Field(gt=0, le=20, allow_inf_nan=False)]
Margin = Annotated[float, Field(ge=0, le=0.5, allow_inf_nan=False)]
_SIZES = {"box": ("size_m",), "cylinder": ("radius_m", "length_m"), "plane": ()}


class Fence(Table):
    """One fence.

    `position_m` and `rpy_deg` (roll about z, then pitch about y, then yaw about x, as RCCL's) are its pose in the base
    frame of the kinematics. A `box` has edges `size_m` about its middle, a `cylinder` stands along its z axis about its
    middle, and a `plane` bounds all that lies behind it, where its z axis comes from. The arm keeps `out` of it or
    stays `in` it: as a whole, or its `links` or its `tool` only, which is what the last link carries. Motions keep
    `margin_m` away from it; the servo guards the fence itself.
    """

    name: GivenName
    shape: FenceShape
    keep: Literal["out", "in"] = "out"
    bodies: Bodies = "all"
    position_m: tuple[Place, Place, Place] = Field(default=(0.0, 0.0, 0.0), strict=False)
    rpy_deg: tuple[Angle, Angle, Angle] = Field(default=(0.0, 0.0, 0.0), strict=False)
    size_m: tuple[Size, Size, Size] | None = Field(default=None, strict=False)
    radius_m: Size | None = None
    length_m: Size | None = None
    margin_m: Margin = 0.02

    @model_validator(mode="after")
    def _has_the_sizes_of_its_shape(self) -> Fence:
        wanted = _SIZES[self.shape]
        for size in ("size_m", "radius_m", "length_m"):
            given = getattr(self, size) is not None
            if given != (size in wanted):
                needs = " and ".join(wanted) or "neither size_m nor radius_m nor length_m"
                raise ValueError(f"fence {self.name!r}: a {self.shape} needs {needs}")
        return self


class Stand(Table):
    """Place of an arm in the hall that the arms of a deployment share: the base frame of its kinematics.

    `rpy_deg` as for a fence.
    """

    position_m: tuple[Place, Place, Place] = Field(default=(0.0, 0.0, 0.0), strict=False)
    rpy_deg: tuple[Angle, Angle, Angle] = Field(default=(0.0, 0.0, 0.0), strict=False)


class FencesChoice(Table):
    """Fences of an arm: motions through one are refused, and the servo stops the arm before it enters one.

    The robot file has to tell the arm's body, as `[shape]`. With `self_collision` its capsules keep
    `self_margin_m` away from each other where the robot file names them `apart`. With `scene` the floor and the table
    top, plate or crank of `[arm.board.scene]` are fences too. A tool from the flange to `servo.tool_mm` is a capsule
    of `tool_radius_m`. `arms` names other arms of the deployment that this one keeps `arm_margin_m` away from; each of
    them needs its own `[arm.stand]`.
    """

    shape: tuple[Fence, ...] = Field(default=(), strict=False)
    self_collision: bool = False
    self_margin_m: Margin = 0.01
    scene: bool = False
    arms: tuple[str, ...] = Field(default=(), strict=False, max_length=MOST_OTHER_ARMS)
    arm_margin_m: Margin = 0.05
    tool_radius_m: float = Field(default=0.02, gt=0, le=0.5, allow_inf_nan=False)

    @model_validator(mode="after")
    def _are_told_apart(self) -> FencesChoice:
        names = [fence.name for fence in self.shape]
        if twice := [name for name in names if names.count(name) > 1]:
            raise ValueError(f"two fences have the same name {twice[0]}")
        if taken := [name for name in names if name in ("itself", "floor", "furniture")]:
            raise ValueError(f"a fence may not be named {taken[0]}: that one is made of robot file or scene")
        if len(names) > MOST_SHAPES - 2:
            raise ValueError(f"{len(names)} fences: {MOST_SHAPES - 2} are possible")
        return self
