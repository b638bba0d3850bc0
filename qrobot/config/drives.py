"""Separate drives on CAN in a deployment file."""

from __future__ import annotations

from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field, model_validator

from qrobot.arrays import Floats
from qrobot.config.can import can_bus_words
from qrobot.config.document import Table
from qrobot.config.robot import Robot, counter_ends

POSITION_END: Final = 1 << 31  # of a position of CiA 402, object 0x6064: 32 bits with a sign

Node = Annotated[int, Field(ge=1, le=127)]
DriveMode = Literal["torque", "position"]
Nonzero = Annotated[float, Field(allow_inf_nan=False)]


class DrivesTransport(Table):
    """A drive of CiA 402 for each joint in place of a board, in cyclic synchronous `mode`: torque or position.

    `nodes` are their numbers, joint by joint. `torque_permille` is the target torque at a converter's +10 V, in
    thousandths of the rated torque; in position mode there is none. A drive's torque is positive where its position
    rises: each sign has to be the opposite of that of `dac_per_Nm` * radians per count * `increments_per_count`, and
    any other is refused. `increments_per_count` is the drive's position increments for a count of the robot file; a
    negative number turns the direction around. `counts_at_zero` is the counter at the drive's position 0; with
    `absolute` encoders it is right after power-up too, and the arm is calibrated by it: a joint over whose range such
    a drive's position of 32 bits would begin anew is refused. Position mode needs that.

    All drives keep their last torque while the answer of one is waited for: `timeout_ms`, and no longer than
    `servo.board_timeout_ms`. Then they are switched off, in position mode stopped quickly.

    Each drive maps control word and target torque (position) to RPDO 1, status word and actual position to TPDO 1, both
    synchronous, and stops by itself when SYNC stays away. No two arms can be on one bus: the SYNC of one would keep the
    other's drives going.
    """

    interface: str = "socketcan"
    channel: str = "can0"
    bitrate: int = Field(default=1_000_000, ge=10_000, le=1_000_000)
    mode: DriveMode = "torque"
    nodes: tuple[Node, ...] = Field(min_length=1, max_length=6, strict=False)
    torque_permille: tuple[Nonzero, ...] = Field(default=(), strict=False)
    increments_per_count: tuple[Nonzero, ...] = Field(strict=False)
    counts_at_zero: tuple[int, ...] = Field(strict=False)
    absolute: bool = False
    period_ms: float = Field(default=2.0, ge=0.2, le=100, allow_inf_nan=False)
    timeout_ms: float = Field(default=50.0, gt=0, le=1000, allow_inf_nan=False)

    @property
    def places(self) -> frozenset[str]:
        """The bus of all drives."""
        return frozenset([can_bus_words(self.interface, self.channel)])

    @model_validator(mode="after")
    def _has_a_number_for_each(self) -> DrivesTransport:
        if len(set(self.nodes)) < len(self.nodes):
            raise ValueError("two drives have the same node number")
        torque = ("torque_permille",) if self.mode == "torque" else ()
        for key in (*torque, "increments_per_count", "counts_at_zero"):
            if len(getattr(self, key)) != len(self.nodes):
                raise ValueError(f"{key} needs {len(self.nodes)} numbers, one for each node")
        if 0 in self.torque_permille or 0 in self.increments_per_count:
            raise ValueError("torque_permille and increments_per_count must not be 0")
        return self

    @model_validator(mode="after")
    def _has_what_position_mode_needs(self) -> DrivesTransport:
        if self.mode == "position" and self.torque_permille:
            raise ValueError("torque_permille has no meaning in position mode: leave it out")
        if self.mode == "position" and not self.absolute:
            raise ValueError("position mode needs absolute = true: counters are not loaded under a position loop")
        return self

    def torque_for(self, robot: Robot) -> tuple[float, ...]:
        """`torque_permille` of a robot's joints with the signs that let each motor turn the right way round.

        A converter's +10 V are the word 0, and so -2048 / `dac_per_Nm` of motor torque; positive torque of a drive lets
        its position rise, by as many increments as `increments_per_count` and the scale of the encoder say.
        """
        n = min(robot.n, len(self.torque_permille))
        scale = robot.transmission.dac_per_Nm * robot.transmission.rad_per_count
        signs = -np.sign(scale[:n] * np.array(self.increments_per_count[:n]))
        return tuple((signs * np.abs(self.torque_permille[:n])).tolist())

    def positions_over(self, robot: Robot) -> Floats:
        """Increments that the drives of a robot's joints show at the ends of their counters. Shape (2, n)."""
        n = min(robot.n, len(self.nodes))
        ends = np.stack(counter_ends(robot.limits, robot.guard, robot.transmission))[:, :n]
        positions: Floats = (ends - self.counts_at_zero[:n]) * self.increments_per_count[:n]
        return positions
