"""The one table of the robot's state: what a servo tells of a robot at one sample, each field in one line.

Whatever carries the state is made from these lines: the block in servo memory and its snapshot
(`servo.memory.published_state`), STATE packets and their codec (`wire.layout`, `wire.codec`), the struct in
`wire/c/qrobot_wire.h`, the registers' neighbours in the operator's status, and the tables of the documentation. A new
field is a line here, and a field of the servo's own state from which it is copied (`servo.state`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cache
from typing import Any, Generic, TypeVar

from qrobot.faultcodes import NO_JOINT
from qrobot.wire.vocabulary import N_ANALOG_OUTPUTS, N_SENSORS, RobotFlag

VectorT = TypeVar("VectorT")


@dataclass(frozen=True)
class StateRow:
    """One line of the table, about a field.

    Attributes:
        name: of the field, everywhere but in the servo's own state.
        code: of the `struct` module, as it travels in STATE; "" for what does not, or stands in the header.
        unit, meaning: for the documentation.
        count: how many numbers; "n" is one per joint.
        source: the field of `servo.state.ServoState` that is told; that of the same name when left out.
        wraps: a counter that travels modulo the range of its code.
    """

    name: str
    code: str
    unit: str
    meaning: str
    count: int | str = 1
    source: str = ""
    wraps: bool = False


def told(
    code: str, unit: str, meaning: str, count: int | str = 1, source: str = "", wraps: bool = False, **default: Any
) -> Any:
    """A line of the table, as a field of a dataclass; see `StateRow`."""
    return field(metadata={"row": (code, unit, meaning, count, source, wraps)}, **default)


@dataclass(frozen=True, slots=True, kw_only=True)
class StateTable(Generic[VectorT]):
    """The robot at one sample, in the order of its fields in STATE; new ones come last.

    Vectors have shape (n,), SI units; `force` has shape (6,). `mode` and codes are plain int, so that those of a newer
    servo get through.
    """

    t_ns: int = told("", "ns", "time of the sample on the servo's monotonic clock")
    mode: int = told("B", "-", "of the servo (see Modes)")
    fault: int = told("H", "-", "code of the fault mode, also while a stop ends in it; 0 for none", default=0)
    event: int = told("H", "-", "newest code of any kind, 0 for none", default=0)
    event_joint: int = told("h", "-", "joint the event speaks of, from 0; -1 for none", default=NO_JOINT)
    flags: int = told("I", "bits", "see Flags", source="flag_bits", default=0)
    late_cycles: int = told("I", "-", "servo cycles that came late, since it started; wraps", wraps=True, default=0)
    missed_frames: int = told(
        "I", "-", "sample periods without a usable COMMAND, since the servo started; wraps", wraps=True, default=0
    )
    inputs: int = told("I", "bits", "binary inputs", default=0)
    hand: int = told("B", "-", "0 relaxed, 1 open, 2 closed", default=0)
    outputs: int = told(
        "H", "bits", "binary outputs in force: a stop may have switched some off that are asked for", default=0
    )
    q: VectorT = told("d", "rad or m", "measured joint positions", "n")
    v: VectorT = told("d", "rad/s or m/s", "measured joint velocities", "n")
    tau: VectorT = told("d", "N·m or N", "commanded joint torques", "n")
    q_setpoint: VectorT = told("d", "rad or m", "where the servo wants the joints at this instant", "n", source="q_ref")
    force: VectorT = told(
        "d", "N, N·m", "on the wrist sensor in its frame: fx fy fz mx my mz; NaN where it is not known", 6
    )
    speed_limit: float = told(
        "d", "-", "share of the joints' greatest speeds that a program may plan; below 1 at reduced speed", default=1.0
    )
    tool_speed_limit: float = told(
        "d", "m/s", "most of the tool's tip; 0 where the limits of the joints are the only ones", default=0.0
    )
    override: float = told("d", "-", "operator's speed override, 0 to 1; 1 is the speed as programmed", default=1.0)
    payload_mass: float = told("d", "kg", "mass of the payload that the servo reckons with", default=0.0)

    sensors: VectorT = told(
        "d",
        "V",
        "at the channels of the board's converter that the servo samples; NaN where one does not answer",
        N_SENSORS,
    )
    analog_outputs: VectorT = told("", "V", "analogue outputs in force; no business of packets", N_ANALOG_OUTPUTS)

    @property
    def powered(self) -> bool:
        """Arm power is on."""
        return bool(self.flags & RobotFlag.POWERED)

    @property
    def calibrated(self) -> bool:
        """The counters are calibrated."""
        return bool(self.flags & RobotFlag.CALIBRATED)

    @property
    def estop_ok(self) -> bool:
        """The emergency stop is released."""
        return bool(self.flags & RobotFlag.ESTOP_OK)

    @property
    def guarded(self) -> bool:
        """The guardian's heartbeat goes on."""
        return bool(self.flags & RobotFlag.GUARDED)

    @property
    def at_rest(self) -> bool:
        """The arm stands still and no motion is pending."""
        return bool(self.flags & RobotFlag.AT_REST)

    @property
    def halted(self) -> bool:
        """Somebody has asked for a stop, or for an end of power, since the servo began to follow setpoints."""
        return bool(self.flags & RobotFlag.HALTED)

    @property
    def paused(self) -> bool:
        """The operator wants motions to stand still on their path."""
        return bool(self.flags & RobotFlag.PAUSED)

    @property
    def torques_known(self) -> bool:
        """`tau` is what drives the joints; drives that close the position loop keep that to themselves."""
        return not self.flags & RobotFlag.NO_TORQUES

    @property
    def motion_override(self) -> float:
        """The operator's override as generators take it: 0 to 1, 0 in a pause; one that cannot be counts as 1."""
        override = self.override if 0.0 <= self.override <= 1.0 else 1.0  # NaN, and what is beyond
        return 0.0 if self.paused else override


def again(table: type[StateTable[Any]], name: str, default: Any) -> Any:
    """A line of a table once more, with a default."""
    line = next(each for each in fields(table) if each.name == name)
    return field(default=default, metadata=line.metadata)


@cache
def rows_of(table: type[StateTable[Any]]) -> tuple[StateRow, ...]:
    """The lines of a table, in their order."""
    return tuple(StateRow(each.name, *each.metadata["row"]) for each in fields(table))
