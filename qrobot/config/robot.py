"""A robot as data: the sections of `config/robots/*.toml`, each value with its source, and what holds between them.

Arrays are read-only float64 in SI units with one entry per joint (shape (n,)) unless said otherwise; a joint unit is
rad for a revolute joint and m for a prismatic one. Nothing here assumes six joints or revolute ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from qrobot.arrays import Bools, Floats, Ints
from qrobot.config.document import Section, Table, check_document, config_path, parse_document, read_content
from qrobot.config.kinds import FileKind
from qrobot.config.shape import Shape
from qrobot.config.values import (
    WIDEST_LINK_M,
    Coupling,
    Degrees,
    Gravity,
    JointDegrees,
    JointDegreesPositive,
    JointKinds,
    LinkLength,
    Mass,
    OneOrPerJoint,
    PerJointChannels,
    PerJointCounts,
    PerJointFlags,
    PerJointInertia,
    PerJointInts,
    PerJointLengths,
    PerJointMasses,
    PerJointNonzero,
    PerJointNotNegative,
    PerJointPlaces,
    PerJointPositive,
    PerJointSigns,
    RobotName,
    frozen,
)
from qrobot.errors import ConfigError

COUNTER_RANGE = (-32768, 32767)  # of a signed 16-bit word
DAC_HALF_RANGE = 2048  # 12-bit offset binary around 0x800 [V]
UNEXPLAINED_SHARE = 0.7  # of tau_max: wrong friction, load and gain together stay below
UNKNOWN_LOAD_SHARE = 0.15  # of the torque limit: 2.5 kg on a PUMA 560
FOLLOWING_SHARE = 0.25  # of a joint's range: a following error beyond it is one in degrees or mm [A],
FOLLOWING_LEAST = 0.1  # unless it is no more than this, rad or m [A]
MARGIN_SHARE = 0.1  # likewise of a margin beyond the range [A]
MARGIN_LEAST = 0.1  # [A]
SLOWEST_STOP_S = 2.0  # from full speed: a stop that takes longer is none [A]
NEEDED_POSES = ("park", "ready", "end")


class Joints(Table):
    """Names and kinds of the joints, base to flange; their number is the robot's n."""

    names: tuple[str, ...] = Field(strict=False, min_length=1)
    kinds: tuple[Literal["revolute", "prismatic"], ...] = Field(strict=False, min_length=1)

    @model_validator(mode="after")
    def _as_many_kinds(self) -> Joints:
        if len(self.names) != len(self.kinds):
            raise ValueError(f"{len(self.names)} names but {len(self.kinds)} kinds")
        if len(set(self.names)) != len(self.names):
            raise ValueError("two joints have the same name")
        return self

    @property
    def prismatic(self) -> Bools:
        """True where the joint slides. Shape (n,)."""
        return np.array([kind == "prismatic" for kind in self.kinds])


class Geometry(Section):
    """Modified Denavit-Hartenberg rows (Craig): Rx(alpha) Tx(a) Rz(theta) Tz(d); the joint adds to theta or to d.

    The base frame of the kinematics is frame 0 of the table; `base_height_m` lifts it above the floor. `flange_m` is
    the distance from the last frame to the mounting flange, along its z.
    """

    family: Literal["puma", "stanford", "generic"]
    alpha_rad: Degrees = Field(alias="alpha_deg")
    a_m: PerJointLengths
    d_m: PerJointLengths
    theta_rad: Degrees = Field(alias="theta_deg")
    base_height_m: LinkLength = Field(ge=0)
    flange_m: LinkLength
    gravity_m_s2: Gravity


class Limits(Section):
    """Joint range, speed and acceleration that no command may exceed, and the heaviest load at the flange (kg)."""

    q_min: JointDegrees = Field(alias="q_min_deg")
    q_max: JointDegrees = Field(alias="q_max_deg")
    v_max: JointDegreesPositive = Field(alias="v_max_deg_s")
    a_max: PerJointPositive
    payload_kg: Mass = 0.0

    @model_validator(mode="after")
    def _range_not_empty(self) -> Limits:
        if not (self.q_min < self.q_max).all():
            raise ValueError("q_min_deg must be below q_max_deg on every joint")
        return self


class Poses(Section, extra="allow"):
    """Named joint positions; every robot has `park`, `ready` and `end`."""

    __pydantic_extra__: dict[str, JointDegrees]

    @model_validator(mode="after")
    def _complete(self) -> Poses:
        if missing := [name for name in NEEDED_POSES if name not in self.by_name]:
            raise ValueError(f"missing pose {', '.join(missing)}")
        return self

    @property
    def by_name(self) -> dict[str, Floats]:
        """Pose name to joint positions."""
        return dict(self.__pydantic_extra__)


class Transmission(Section):
    """Ratios and scales from motor and encoder to joint, and from joint torque to DAC.

    `gear` is motor radians per joint unit. `coupling` is C of r = C (q - q_offset): motor displacements in joint units.
    `dac_per_Nm` is signed; on a prismatic joint it is DAC counts per newton. `count_offset` is what the host adds to a
    counter so that the joint's range fits a signed 16-bit word. `pot_channel` is the ADC channel of the joint's
    potentiometer, by default 0 for the first and so on; `pot_at_zero` and `pot_per_rev` are ADC units of
    20 V/65536 at encoder zero and per motor turn in the direction of rising counts, one number where it is
    the same on all joints. With `scales = "vendor"` the board vendor's radians per count replace those that follow
    from `count_sign`, `counts_per_rev` and `gear` (shape (n,), signed).
    """

    gear: PerJointPositive
    rotor_inertia: PerJointPositive
    coupling: Coupling
    counts_per_rev: PerJointCounts
    count_sign: PerJointSigns
    count_offset: PerJointInts
    q_offset: JointDegrees = Field(alias="q_offset_deg")
    dac_per_Nm: PerJointNonzero  # noqa: N815 (newton-metre)
    brake: PerJointFlags
    index_phase: PerJointInts
    pot_at_zero: PerJointPositive
    pot_per_rev: OneOrPerJoint
    scales: Literal["gear", "vendor"]
    vendor_rad_per_count: PerJointNonzero | None = None
    pot_channel: PerJointChannels | None = None

    @model_validator(mode="after")
    def _vendor_scales_given(self) -> Transmission:
        if self.scales == "vendor" and self.vendor_rad_per_count is None:
            raise ValueError('scales = "vendor" needs vendor_rad_per_count')
        return self

    @property
    def pot_channels(self) -> Ints:
        """ADC channel of each joint's potentiometer. Shape (n,)."""
        return np.arange(self.gear.size) if self.pot_channel is None else self.pot_channel

    @property
    def pots_per_rev(self) -> Floats:
        """ADC units by which each potentiometer rises in a motor turn of rising counts. Shape (n,)."""
        return frozen(np.broadcast_to(np.asarray(self.pot_per_rev, dtype=np.float64), self.gear.shape))

    @property
    def rad_per_count(self) -> Floats:
        """Signed motor-side joint units per encoder count, by the scales chosen. Shape (n,)."""
        if self.scales == "vendor" and self.vendor_rad_per_count is not None:
            return self.vendor_rad_per_count
        return frozen(self.count_sign * 2.0 * np.pi / (self.counts_per_rev * self.gear))

    def count_rates(self, v: Floats) -> Floats:
        """Greatest speed of each counter, counts/s, for joints at speeds up to `v`, whichever way each. Shape (n,)."""
        return frozen(np.abs(self.coupling) @ v / np.abs(self.rad_per_count))

    def counts_between(self, low: Floats, high: Floats) -> tuple[Floats, Floats]:
        """Least and greatest counter of each motor, offset included, for joints from `low` to `high`. Shapes (n,)."""
        with np.errstate(all="ignore"):  # a file's numbers may be absurd
            counts_per_joint = self.coupling / self.rad_per_count[:, None]
            ends = np.array([counts_per_joint * (low - self.q_offset), counts_per_joint * (high - self.q_offset)])
            return ends.min(0).sum(1) + self.count_offset, ends.max(0).sum(1) + self.count_offset


class Links(Section):
    """Rigid bodies: mass in kg, centre of mass in m, principal inertia about it in kg·m², axes of the link frame."""

    mass: PerJointMasses
    com: PerJointPlaces
    inertia: PerJointInertia

    @model_validator(mode="after")
    def _of_bodies(self) -> Links:
        weighs = self.mass > 0.0
        if (self.inertia.max(axis=1)[weighs] > self.mass[weighs] * WIDEST_LINK_M**2).any():
            raise ValueError(f"inertia must be kg m2: one of these is of a body {2 * WIDEST_LINK_M:g} m wide")
        return self


class Friction(Section):
    """Joint-side friction: viscous (N·m·s/rad), Coulomb in each direction (N·m, magnitude), break-away over Coulomb."""

    viscous: PerJointNotNegative
    coulomb_pos: PerJointNotNegative
    coulomb_neg: PerJointNotNegative
    stiction_factor: float = Field(ge=1, allow_inf_nan=False)


class Control(Section):
    """Gains and choices of the control law.

    `inertia` is the constant M0 of the acceleration feed-forward; `friction_velocity` the speed within which the
    friction compensation passes smoothly through zero. Which of the velocity's two bandwidths counts is the
    deployment's choice: the low pass of the difference or the poles of the observer.
    """

    kp: PerJointPositive
    kv: PerJointNotNegative
    inertia: PerJointPositive
    velocity_filter_hz: float = Field(gt=0, allow_inf_nan=False)
    velocity_observer_hz: float = Field(default=20.0, gt=0, allow_inf_nan=False)
    gravity_joints: PerJointFlags
    friction_preset: str
    friction_velocity: PerJointPositive

    @property
    def stop_overshoot_s(self) -> Floats:
        """Overshoot of each joint over the reference of a stop, in seconds of its speed. Shape (n,)."""
        return frozen(np.sqrt(self.inertia / self.kp) / np.e)


class Guard(Section):
    """Limits of the checks: torque, speed over `v_max`, following error, travel beyond the limits, first setpoint.

    `unexplained_torque` is what a joint may be pushed by that neither its command nor its model accounts for (N·m, N);
    left out it is 70 % of `tau_max`; motions add what it takes to accelerate `limits.payload_kg`. `runaway_share` of
    `v_max` is how much faster than its reference a joint so pushed may be. `brake_slip` is how far a braked joint may
    move without power (rad, m); `saturation_s` how long a torque may stay at its limit. `unknown_load` is what a load
    in the hand and wrong weights may put on a joint at rest (N·m, N); left out it is 15 % of `tau_max`.

    Numbers that would let everything pass, perhaps in another unit, are refused.
    """

    tau_max: PerJointPositive
    velocity_factor: float = Field(ge=1, le=1.5, allow_inf_nan=False)
    following_error: PerJointPositive
    start_tolerance: float = Field(gt=0, allow_inf_nan=False)
    range_margin: PerJointNotNegative
    a_stop: PerJointPositive
    unexplained_torque: PerJointPositive | None = None
    runaway_share: float = Field(default=0.03, gt=0, le=1, allow_inf_nan=False)
    brake_slip: float = Field(default=0.0087, gt=0, le=0.1, allow_inf_nan=False)
    saturation_s: float = Field(default=0.5, gt=0, le=10, allow_inf_nan=False)
    unknown_load: PerJointNotNegative | None = None

    @property
    def unknown_load_or_default(self) -> Floats:
        """Bound of the load on each joint that nobody told of. Shape (n,), N·m (N)."""
        given = self.unknown_load
        return frozen(UNKNOWN_LOAD_SHARE * self.tau_max) if given is None else given

    @property
    def unexplained_torque_or_default(self) -> Floats:
        """Threshold of the torque nobody commanded. Shape (n,), N·m (N)."""
        given = self.unexplained_torque
        return frozen(UNEXPLAINED_SHARE * self.tau_max) if given is None else given


class BoardSection(Section):
    """The interface board that drives the arm."""

    revision: Literal["E", "F"]


class Robot(Table):
    """One robot. Immutable; arrays are read-only."""

    name: RobotName
    about: str = ""
    joints: Joints
    geometry: Geometry
    limits: Limits
    pose_section: Poses = Field(alias="poses")
    transmission: Transmission
    links: Links
    friction: dict[str, Friction] = Field(min_length=1)
    control: Control
    guard: Guard
    board: BoardSection
    shape: Shape | None = None

    @model_validator(mode="after")
    def _sections_agree(self) -> Robot:
        if faults := list(_disagreements(self)):
            raise ValueError("; ".join(faults))
        return self

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints.names)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, base to flange."""
        return self.joints.names

    @property
    def prismatic(self) -> Bools:
        """True where the joint slides. Shape (n,)."""
        return self.joints.prismatic

    @property
    def poses(self) -> dict[str, Floats]:
        """Named joint positions, internal (VAL) convention."""
        return self.pose_section.by_name


def _disagreements(robot: Robot) -> Iterator[str]:
    """Contradictions between sections, one line each."""
    low, high = robot.limits.q_min, robot.limits.q_max
    for name, pose in robot.poses.items():
        if not ((low <= pose) & (pose <= high)).all():
            yield f"poses.{name} lies outside limits"
    if robot.control.friction_preset not in robot.friction:
        yield f"control.friction_preset must be one of {', '.join(robot.friction)}"
    if (robot.guard.tau_max > DAC_HALF_RANGE / np.abs(robot.transmission.dac_per_Nm)).any():
        yield "guard.tau_max exceeds what the DAC can ask for"
    yield from _guards_nothing(robot.guard, robot.limits)
    yield from _beyond_the_counters(robot)
    for capsule in robot.shape.capsules if robot.shape else ():
        if capsule.link > robot.n:
            yield f"shape.capsules: {capsule.name} is fixed to link {capsule.link}, and the last is {robot.n}"
    if robot.geometry.family == "puma" and not _is_puma(robot):
        yield 'geometry.family = "puma" needs the link twists and the zero offsets of a PUMA (modified DH)'
    if robot.geometry.family == "stanford" and not _is_stanford(robot):
        yield 'geometry.family = "stanford" needs the link frames of a Stanford arm (modified DH) and a boom beyond 0'


def _guards_nothing(guard: Guard, limits: Limits) -> Iterator[str]:
    """Limits of the checks so wide, perhaps in another unit, that they would let everything pass."""
    if (guard.a_stop > limits.a_max).any():
        yield "guard.a_stop exceeds limits.a_max"
    if (guard.a_stop * SLOWEST_STOP_S < limits.v_max).any():
        yield f"guard.a_stop takes more than {SLOWEST_STOP_S:g} s to stop a joint at limits.v_max"
    if (guard.following_error > np.maximum(FOLLOWING_SHARE * (limits.q_max - limits.q_min), FOLLOWING_LEAST)).any():
        yield f"guard.following_error exceeds {FOLLOWING_SHARE:.0%} of the joint's range (it is in rad or m)"
    if guard.start_tolerance > guard.following_error.min():
        yield "guard.start_tolerance exceeds guard.following_error"
    if (guard.range_margin > np.maximum(MARGIN_SHARE * (limits.q_max - limits.q_min), MARGIN_LEAST)).any():
        yield f"guard.range_margin exceeds {MARGIN_SHARE:.0%} of the joint's range (it is in rad or m)"
    if (guard.unknown_load_or_default > guard.tau_max).any():
        yield "guard.unknown_load exceeds guard.tau_max: no motor could show that its encoder is dead"
    if (guard.unexplained_torque_or_default > guard.tau_max).any():
        yield "guard.unexplained_torque exceeds guard.tau_max: no motor could show that it does not obey"


def counter_ends(limits: Limits, guard: Guard, transmission: Transmission) -> tuple[Floats, Floats]:
    """Least and greatest counter of each motor over limits and `guard.range_margin`. Shapes (n,)."""
    return transmission.counts_between(limits.q_min - guard.range_margin, limits.q_max + guard.range_margin)


def _beyond_the_counters(robot: Robot) -> Iterator[str]:
    """Joints for whose range a counter is too short: two positions would look the same, and a servo takes the wrong."""
    first, last = COUNTER_RANGE
    least, most = counter_ends(robot.limits, robot.guard, robot.transmission)
    for joint in np.flatnonzero(~((least >= first) & (most <= last))).tolist():
        low, high = float(least[joint]), float(most[joint])
        remedy = "fewer counts_per_rev (separate drives: more increments_per_count), or a shorter range"
        if high - low <= last - first:
            centred = int(robot.transmission.count_offset[joint]) - round((low + high) / 2.0)
            remedy = f"another count_offset, such as {centred}"
        yield (
            f"transmission: the counter of joint {joint + 1} would go from {low:.0f} to {high:.0f} over limits and "
            f"guard.range_margin, and ends at {first} and {last}: {remedy}"
        )


def closed_form_family(robot: Robot) -> Literal["puma", "stanford", "generic"]:
    """The family whose closed-form inverse this geometry has; generic when it has none."""
    if _is_puma(robot):
        return "puma"
    return "stanford" if _is_stanford(robot) else "generic"


def _is_puma(robot: Robot) -> bool:
    """Six revolute joints, AKB's twists; lengths are zero where the inverse leaves them out, and only there."""
    if robot.n != 6 or robot.prismatic.any():
        return False
    g = robot.geometry
    twists = np.radians([0, -90, 0, 90, -90, 90])
    zeros = [*g.theta_rad, *g.a_m[[0, 1, 4, 5]], *g.d_m[[0, 4, 5]]]
    lengths = [g.a_m[2], g.d_m[1] + g.d_m[2], g.d_m[3]]
    return bool(np.allclose(g.alpha_rad, twists) and not np.any(zeros) and np.all(lengths))


def _is_stanford(robot: Robot) -> bool:
    """A boom that slides and never passes the shoulder, between revolute joints; one offset, at the shoulder."""
    if robot.n != 6 or robot.prismatic.tolist() != [False, False, True, False, False, False]:
        return False
    g = robot.geometry
    twists, zeros = np.radians([0, -90, 90, 0, -90, 90]), np.radians([0, 0, -90, 0, 0, 0])
    straight = np.allclose(g.alpha_rad, twists) and np.allclose(g.theta_rad, zeros)
    return bool(straight and not np.any([*g.a_m, *g.d_m[2:]]) and robot.limits.q_min[2] > 0.0)


def robot_path(name_or_path: str | Path) -> Path:
    """Path of a robot file: of a packaged robot by name, or the path given if it ends in `.toml`.

    Raises:
        ConfigError: no such robot; names the nearest known one.
    """
    return config_path(name_or_path, FileKind.ROBOT, "robots")


def load_robot(name_or_path: str | Path) -> Robot:
    """Load and validate a robot.

    Raises:
        ConfigError: no such file, or every mistake in it with its path in the file.
    """
    path = robot_path(name_or_path)
    return _robot_in(read_content(path), str(path))


@lru_cache(maxsize=16)
def _robot_in(content: bytes, label: str) -> Robot:
    """The robot of a file's content, made once, with arrays that are read-only: a program asks for its arms' often."""
    return robot_of(parse_document(content, label), label)


def robot_of(document: dict[str, Any], label: str) -> Robot:
    """Make a robot of a parsed document; `label` stands in front of the mistakes.

    Raises:
        ConfigError: lists every mistake.
    """
    if not isinstance(document.get("joints"), dict):
        raise ConfigError(f"{label}: joints: missing")
    joints = check_document(Joints, document["joints"], f"{label}: [joints]")
    return check_document(Robot, document, label, JointKinds(joints.prismatic))
