"""Surroundings of an emulated arm, the load of its flange, and the force sensor between the two."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from qrobot.config.document import Table

SceneKind = Literal["empty", "floor", "table", "crank", "peg"]
ForceAxis = Literal["fx", "fy", "fz", "tx", "ty", "tz"]
FORCE_AXES: tuple[ForceAxis, ...] = ("fx", "fy", "fz", "tx", "ty", "tz")

Length = Annotated[float, Field(gt=0, le=2, allow_inf_nan=False)]
Place = Annotated[float, Field(ge=-10, le=10, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
ConverterChannel = Annotated[int, Field(ge=0, le=7)]


class Tool(Table):
    """A round rod with a round tip, along z of the flange, which touches things; of its weight the servo knows nothing.

    Its end is `length_m` from the flange.
    """

    length_m: Length = 0.1
    radius_m: Length = 0.01
    mass_kg: Positive = 0.2

    @model_validator(mode="after")
    def _is_longer_than_thick(self) -> Tool:
        if self.length_m <= 2 * self.radius_m:
            raise ValueError(f"length_m {self.length_m:g} must be more than twice radius_m {self.radius_m:g}")
        return self


class Scene(Table):
    """Surroundings of the emulated arm.

    `floor` is a floor and nothing else; the others have one too. `table` is a table top; `peg` a plate with a hole,
    into which the tool fits with `clearance_m` all around; `crank` turns about a vertical axis and has such a hole at
    `crank_radius_m` from it. `position_m`, in the base frame of the kinematics, is the middle of the table top, of the
    mouth of the plate's hole, or the axis of the crank at the height of the mouth of its hole. The hole of the crank is
    in direction x of its axis at first. `contact_s` is the time constant of a contact: the longer, the softer.
    """

    kind: SceneKind = "empty"
    position_m: tuple[Place, Place, Place] = Field(default=(0.5, 0.0, -0.3), strict=False)
    contact_s: float = Field(default=0.004, ge=0.001, le=0.1, allow_inf_nan=False)
    friction: NotNegative = 0.2
    clearance_m: Positive = 0.001
    depth_m: Length = 0.03
    crank_radius_m: Length = 0.1
    crank_inertia_kg_m2: Positive = 0.02
    crank_friction_n_m: NotNegative = 0.5
    tool: Tool = Tool()

    @model_validator(mode="after")
    def _turns_around_its_hole(self) -> Scene:
        reach = 2 * (self.tool.radius_m + self.clearance_m)
        if self.kind == "crank" and self.crank_radius_m < reach:
            raise ValueError(f"crank_radius_m {self.crank_radius_m:g} is too small: at least {reach:g} for its hole")
        return self


class ForceSensor(Table):
    """Force and torque sensor at the flange, wired to free channels of the board's converter.

    `channels` tells the channel of each component that is wired, `{ fz = 6 }`: forces and torques of the tool on the
    flange, in the frame of the flange, the tool's weight included. Its amplifier has an offset `zero_v` and a low-pass
    filter; the converter clips at 10 V.
    """

    channels: dict[ForceAxis, ConverterChannel] = Field(min_length=1)
    newton_per_volt: Positive = 10.0
    newton_metre_per_volt: Positive = 1.0
    zero_v: float = Field(default=0.05, ge=-10, le=10, allow_inf_nan=False)
    noise_v: NotNegative = 0.005
    filter_hz: Positive = 300.0

    @model_validator(mode="after")
    def _has_a_channel_for_each(self) -> ForceSensor:
        if len(set(self.channels.values())) < len(self.channels):
            raise ValueError("two components of the force sensor have the same channel")
        return self
