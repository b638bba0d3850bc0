"""A robot file made of a URDF: what the URDF tells, and the rest from a robot like it or from a file beside.

A URDF knows geometry, ranges, masses and perhaps friction. It does not know gears, encoders, converters, gains, poses
or what the guard should allow; nobody can guess these for an arm of metal, so they are asked for by name.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from qrobot.arrays import Bools, Floats, Ints
from qrobot.config.document import check_document, read_document
from qrobot.config.robot import (
    COUNTER_RANGE,
    DAC_HALF_RANGE,
    NEEDED_POSES,
    Guard,
    Joints,
    Limits,
    Robot,
    Transmission,
    closed_form_family,
    counter_ends,
    load_robot,
    robot_of,
)
from qrobot.config.values import JointKinds
from qrobot.errors import ConfigError
from qrobot.exchange.denavit_hartenberg import DenavitHartenberg, denavit_hartenberg
from qrobot.exchange.robot_document import Document, robot_document
from qrobot.exchange.serial_chain import ChainLink, SerialChain, serial_chain
from qrobot.exchange.urdf_document import LinkBody, read_urdf
from qrobot.model.transform import inverse, so3_log, transform
from qrobot.units import DEG_PER_RAD, MM_PER_M

FRICTION: Final = "urdf"
STANDARD_GRAVITY: Final = 9.81  # m/s2, as in the packaged robot files
HALF_TURN: Final = np.pi
_OFF: Final = 1e-9  # m, rad
_DIGITS: Final = 12
_BORROWED: Final = "[A] as on "
_FARTHEST: Final = 1e9  # counts that an offset takes away
_FILLED: Final = 0.95  # of a counter, by encoders made up [A]
_ROUNDED: Final = (1e-12, 2e-3)  # rad off a right angle: beyond what numbers of 64 bits cost, up to 3.14 for pi [A]
_SLANTED: Final = 1e-6  # kg m2: inertia off the axes below which nothing is said [A]


@dataclass(frozen=True)
class Imported:
    """A robot made of a URDF, its file as a document, and what whoever uses it has to know."""

    robot: Robot
    document: Document
    notes: tuple[str, ...]


@dataclass
class _Told:
    """Values of a URDF, section by section, each with its source."""

    name: str
    source: str
    joints: Document
    sections: dict[str, Document] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def tell(self, section: str, key: str, value: Any, source: str = "") -> None:
        """Add a value."""
        table = self.sections.setdefault(section, {"source": {}})
        table[key] = value
        table["source"][key] = source or self.source


def import_urdf(path: Path, tip: str | None = None, like: str | None = None, beside: Path | None = None) -> Imported:
    """Make a robot of a URDF.

    Values that the URDF does not tell are those of the robot `like`, and before them those of the TOML file `beside`,
    which has the sections of a robot file. What the URDF tells is taken from it, unless `beside` says otherwise.

    Raises:
        ConfigError: the URDF cannot be read or is no serial arm; or values are missing, each named.
    """
    chain = serial_chain(read_urdf(path), tip)
    told = _told(chain, path)
    own = {} if beside is None else _sections_beside(beside)
    document = _merged_document(told, like, own)
    if "tau_max" not in own.get("guard", {}):
        _fit_torque_limits(document, chain)
    if "unexplained_torque" not in own.get("guard", {}):
        _fit_thresholds(document.get("guard", {}))
    _complete_poses(document, told.notes)
    _fit_counters(document, told.notes)
    robot = _robot(document, path, like)
    if robot.geometry.family == "generic" and "geometry" not in own:
        told.notes.extend(_rounded_angles(document, chain, path.name))
    return Imported(robot, document, tuple(told.notes))


def _told(chain: SerialChain, path: Path) -> _Told:
    kinds = ["prismatic" if link.joint.kind == "prismatic" else "revolute" for link in chain.links]
    told = _Told(
        _robot_name(chain.name),
        f"URDF {path.name}",
        {"names": [link.joint.name for link in chain.links], "kinds": kinds},
    )
    rows = denavit_hartenberg([link.T_previous_joint for link in chain.links], chain.T_last_tip)
    _tell_base(told, chain.T_root_base, rows.T_base_0)
    _tell_geometry(told, rows, inverse(rows.T_joint_frame[-1]) @ chain.T_last_tip)
    _tell_limits(told, chain.links)
    _tell_links(told, chain.links, rows.T_joint_frame)
    _tell_friction(told, chain.links)
    if chain.stiffened:
        told.notes.append(f"taken as fixed at zero: {', '.join(chain.stiffened)}")
    return told


def _tell_geometry(told: _Told, rows: DenavitHartenberg, T_last_tip: Floats) -> None:
    source = f"{told.source}: common normals of its axes, modified DH"
    for key, values in _row_values(rows).items():
        told.tell("geometry", key, values, source)
    told.tell("geometry", "flange_m", _plain(T_last_tip[2, 3]), f"{told.source}: the tip along the last axis")
    told.tell("geometry", "family", "generic", "what its geometry allows")
    _note_tip(told, T_last_tip)


def _row_values(rows: DenavitHartenberg) -> Document:
    """Rows as a robot file has them."""
    alpha_deg, theta_deg = _plain(rows.alpha * DEG_PER_RAD), _plain(rows.theta * DEG_PER_RAD)
    return {"alpha_deg": alpha_deg, "a_m": _plain(rows.a), "d_m": _plain(rows.d), "theta_deg": theta_deg}


def _rounded_angles(document: Document, chain: SerialChain, label: str) -> list[str]:
    """Note about right angles of joints that somebody has rounded, where exact ones give a closed-form inverse."""
    turns = {link.joint.name: link.T_previous_joint for link in chain.links}
    off = {name: float(np.abs(T[:3, :3] - np.rint(T[:3, :3])).max()) for name, T in turns.items()}
    rounded = [name for name, angle in off.items() if _ROUNDED[0] < angle < _ROUNDED[1]]
    if not rounded:
        return []
    rows = denavit_hartenberg([_squared(T) for T in turns.values()], _squared(chain.T_last_tip))
    exact = robot_of(document | {"geometry": document["geometry"] | _row_values(rows)}, label)
    family = closed_form_family(exact)
    if family == "generic":
        return []
    return [
        f"{', '.join(rounded)}: right angles to within {max(off[name] for name in rounded):.1g} rad; if they were "
        f"rounded, write 1.5707963267948966 for 1.5708: the arm then has the closed-form inverse of family {family!r}"
    ]


def _squared(T: Floats) -> Floats:
    """A frame turned by exact right angles where it is nearly so. Shapes (4, 4)."""
    R = np.rint(T[:3, :3])
    return transform(R, T[:3, 3]) if np.abs(T[:3, :3] - R).max() < _ROUNDED[1] else T


def _tell_base(told: _Told, T_root_base: Floats, T_base_0: Floats) -> None:
    """Lift frame 0 and turn gravity, which a robot file can say; what is left of the base's place becomes a note."""
    T = T_root_base @ T_base_0
    gravity = T[:3, :3].T @ [0.0, 0.0, -STANDARD_GRAVITY]
    told.tell("geometry", "gravity_m_s2", _plain(gravity), "[A] z of the URDF's root link is up, standard gravity")
    height = max(float(T[2, 3]), 0.0)
    told.tell("geometry", "base_height_m", _plain(height), f"{told.source}: frame 0 over the root link")
    left = transform(None, [0.0, 0.0, -height]) @ T
    aside, turn = left[:3, 3], so3_log(left[:3, :3])
    if np.abs(aside).max() > _OFF or np.abs(turn).max() > _OFF:
        told.notes.append(f"frame 0 of the arm is {_place(aside, turn)} from the root link at that height")


def _note_tip(told: _Told, T_last_tip: Floats) -> None:
    """Tell as a note how far the tip is off a flange along the last axis."""
    aside, turn = np.append(T_last_tip[:2, 3], 0.0), so3_log(T_last_tip[:3, :3])
    if np.abs(aside).max() > _OFF or np.abs(turn).max() > _OFF:
        told.notes.append(f"the tip is {_place(aside, turn)} from the flange: a tool, for the program to set")


def _place(aside: Floats, turn: Floats) -> str:
    """A displacement and a rotation vector for people. Shapes (3,)."""
    millimetres, degrees = (", ".join(f"{x:.6g}" for x in v) for v in (aside * MM_PER_M, turn * DEG_PER_RAD))
    return f"({millimetres}) mm and ({degrees}) deg"


def _tell_limits(told: _Told, links: tuple[ChainLink, ...]) -> None:
    ranges = [_range(told, link) for link in links]
    for key, column in (("q_min_deg", 0), ("q_max_deg", 1)):
        if all(low_high is not None for low_high in ranges):
            told.tell("limits", key, [_plain(low_high[column]) for low_high in ranges if low_high is not None])
    speeds = [None if (v := link.joint.velocity) is None else _in_file_units(link, v) for link in links]
    if all(speeds):
        told.tell("limits", "v_max_deg_s", _plain([speed for speed in speeds if speed is not None]))


def _range(told: _Told, link: ChainLink) -> tuple[float, float] | None:
    """Lowest and highest position in degrees (m); None where the URDF has none."""
    joint = link.joint
    if joint.kind == "continuous":
        told.notes.append(f"{joint.name} turns without end; its range is taken as half a turn each way")
        return -HALF_TURN * DEG_PER_RAD, HALF_TURN * DEG_PER_RAD
    if joint.lower is None or joint.upper is None or not joint.lower < joint.upper:
        return None
    return _in_file_units(link, joint.lower), _in_file_units(link, joint.upper)


def _in_file_units(link: ChainLink, value: float) -> float:
    """Degrees of a joint that turns, metres of one that slides."""
    return value if link.joint.kind == "prismatic" else value * DEG_PER_RAD


def _tell_links(told: _Told, links: tuple[ChainLink, ...], T_joint_frame: Floats) -> None:
    bodies = [_seen_from(T, link.body) for T, link in zip(T_joint_frame, links, strict=True)]
    if not any(body.mass > 0.0 for body in bodies):
        return  # a URDF for viewers
    weightless = [link.joint.name for link, body in zip(links, bodies, strict=True) if body.mass == 0.0]
    if weightless:
        told.notes.append(f"what moves with {', '.join(weightless)} weighs nothing in the URDF: correct links.mass")
    told.tell("links", "mass", _plain([body.mass for body in bodies]))
    told.tell("links", "com", _plain([body.com for body in bodies]))
    told.tell("links", "inertia", _plain([np.diag(body.inertia) for body in bodies]))
    slant = max(float(np.abs(body.inertia - np.diag(np.diag(body.inertia))).max()) for body in bodies)
    if slant > _SLANTED:
        told.notes.append(f"products of inertia are left out, the largest of them {slant:.3g} kg m2")


def _seen_from(T_joint_frame: Floats, body: LinkBody) -> LinkBody:
    """A body of the joint's frame in the row's."""
    T = inverse(T_joint_frame)
    R = T[:3, :3]
    return LinkBody(body.mass, R @ body.com + T[:3, 3], R @ body.inertia @ R.T)


def _tell_friction(told: _Told, links: tuple[ChainLink, ...]) -> None:
    damping, dry = [link.joint.damping for link in links], [link.joint.friction for link in links]
    if not any(damping) and not any(dry):
        return
    section = f"friction.{FRICTION}"
    told.tell(section, "viscous", _plain(damping))
    for key in ("coulomb_pos", "coulomb_neg"):
        told.tell(section, key, _plain(dry))
    told.tell(section, "stiction_factor", 1.0, "[A] a URDF tells none")
    told.tell("control", "friction_preset", FRICTION, "[A] that of the URDF")
    told.notes.append("friction is that of the URDF; many are made for a simulation alone")


def _merged_document(told: _Told, like: str | None, own: Document) -> Document:
    """The sections of `like`, over them those of the URDF, over them the user's `own`."""
    document: Document = {} if like is None else _borrowed(like, told.joints)
    document["joints"] = told.joints
    document["name"] = told.name
    document["about"] = f"made of {told.source}" + ("" if like is None else f", drives and gains as {like}")
    for section, table in told.sections.items():
        _overlay(document, section.split("."), table)
    for section, table in own.items():
        _overlay(document, [section], table)
    return document


def _sections_beside(path: Path) -> Document:
    """Sections of the user's file. Raises ConfigError where a single value stands in the place of a table."""
    document: Document = read_document(path)
    for section, table in document.items():
        if section in ("name", "about"):
            continue
        if not isinstance(table, dict):
            raise ConfigError(f"{path}: {section} must be a section of a robot file, [{section}], with values in it")
        if not isinstance(table.get("source", {}), dict):
            raise ConfigError(f"{path}: {section}.source must name the source of each value")
    return document


def _borrowed(like: str, joints: Document) -> Document:
    """Sections of an arm of the same joints without its geometry and its body, each value marked as borrowed."""
    robot = load_robot(like)
    if list(robot.joints.kinds) != joints["kinds"]:
        raise ConfigError(f"{like} is not like it: its joints are {', '.join(robot.joints.kinds)}")
    document = robot_document(robot)
    for table in _sections(document):
        table["source"] = dict.fromkeys(table["source"], f"{_BORROWED}{robot.name}")
    for own in ("name", "geometry", "shape"):
        document.pop(own, None)
    return document


def _sections(document: Document) -> Iterable[Document]:
    """Every table with sources, those of friction too."""
    for table in document.values():
        if isinstance(table, dict):
            yield from [table] if "source" in table else _sections(table)


def _overlay(document: Document, path: list[str], value: Any) -> None:
    """Put a value, or the entries of a table, in the place of what is there."""
    if not isinstance(value, Mapping):
        document[path[0]] = value
        return
    for part in path:
        document = document.setdefault(part, {})
    for key, entry in value.items():
        _overlay(document, [key], entry)


def _robot_name(stem: str) -> str:
    """A name as robot files have them."""
    name = "".join(letter if letter.isascii() and letter.isalnum() else "_" for letter in stem.lower()).strip("_")
    return name if name[:1].isalpha() else f"robot_{name}".rstrip("_")


def _fit_torque_limits(document: Document, chain: SerialChain) -> None:
    """Limits of torque from the URDF's efforts, no higher than the converters can ask for."""
    efforts = [link.joint.effort for link in chain.links]
    scales = _row(document.get("transmission", {}).get("dac_per_Nm"))
    if not all(efforts) or scales is None or len(scales) != len(efforts) or not (np.abs(scales) > 0.0).all():
        return
    most = DAC_HALF_RANGE / np.abs(scales)  # not rounded: what is rounded up is more than the converters can ask for
    guard = document.setdefault("guard", {"source": {}})
    guard["tau_max"] = np.minimum(_plain(efforts), most).tolist()
    guard.setdefault("source", {})["tau_max"] = "URDF: effort, at most what the converters can ask for"


def _fit_thresholds(guard: Document) -> None:
    """Leave out thresholds of another arm that the motors of this one could not pass: shares of the limits, then."""
    limits = _row(guard.get("tau_max"))
    for name in ("unexplained_torque", "unknown_load"):
        threshold = _row(guard.get(name))
        if threshold is None or limits is None or len(threshold) != len(limits) or (threshold <= limits).all():
            continue
        del guard[name]
        guard.get("source", {}).pop(name, None)


def _complete_poses(document: Document, notes: list[str]) -> None:
    """Poses that the range of another arm allowed, and this one's does not, become the middle of its range."""
    limits = document.get("limits", {})
    low, high = _row(limits.get("q_min_deg")), _row(limits.get("q_max_deg"))
    if low is None or high is None or len(low) != len(high):
        return
    poses = document.setdefault("poses", {"source": {}})
    middle = _plain(np.clip(0.0, low, high))
    for name in [*NEEDED_POSES, *(key for key in poses if key not in (*NEEDED_POSES, "source"))]:
        if name not in poses or _outside(_row(poses[name]), low, high):
            poses[name] = middle
            poses.setdefault("source", {})[name] = "[A] zero, or the end of the range that is nearest to it"
            notes.append(f"pose {name} is made up: give it a better one")


def _fit_counters(document: Document, notes: list[str]) -> None:
    """Encoders of another arm that count too far for this one's range count more coarsely, or from another zero.

    A file that is damaged is left as it is: whoever checks the whole of it says what is wrong.
    """
    try:
        limits, guard, transmission = _counted(document)
    except (ConfigError, KeyError):
        return
    table, (first, last) = document["transmission"], COUNTER_RANGE
    least, most = counter_ends(limits, guard, transmission)
    outside = ~((least >= first) & (most <= last))
    long = most - least > last - first
    if long.any() and _is_borrowed(table, "counts_per_rev"):
        share = np.where(long, _FILLED * (last - first) / (most - least), 1.0)
        counts_per_rev = np.maximum((transmission.counts_per_rev * share).astype(np.int64), 1)
        transmission = transmission.model_copy(update={"counts_per_rev": counts_per_rev})
        _make_up(table, "counts_per_rev", counts_per_rev, long, notes)
        least, most = counter_ends(limits, guard, transmission)
    outside &= most - least <= last - first
    if outside.any() and _is_borrowed(table, "count_offset"):
        middle = np.where(outside, np.clip((least + most) / 2.0, -_FARTHEST, _FARTHEST), 0.0)
        _make_up(table, "count_offset", transmission.count_offset - np.round(middle).astype(np.int64), outside, notes)


def _counted(document: Document) -> tuple[Limits, Guard, Transmission]:
    """The sections that say how far counters go. Raises ConfigError or KeyError."""
    kinds = JointKinds(check_document(Joints, document["joints"], "joints").prismatic)
    return (
        check_document(Limits, document["limits"], "limits", kinds),
        check_document(Guard, document["guard"], "guard", kinds),
        check_document(Transmission, document["transmission"], "transmission", kinds),
    )


def _is_borrowed(table: Document, key: str) -> bool:
    return str(table["source"][key]).startswith(_BORROWED)


def _make_up(table: Document, key: str, values: Ints, where: Bools, notes: list[str]) -> None:
    """Put values of our own into the transmission, and say so."""
    table[key], joints = values.tolist(), ", ".join(str(joint + 1) for joint in np.flatnonzero(where))
    table["source"][key] = f"[A] so that the range fits a 16-bit counter, on joint {joints}"
    notes.append(f"{key} of joint {joints} is made up, for its range to fit a 16-bit counter: give that of its encoder")


def _outside(pose: Floats | None, low: Floats, high: Floats) -> bool:
    """True of a pose out of range; one that is none at all is refused with the rest of the file."""
    return pose is not None and len(pose) == len(low) and bool(((pose < low) | (pose > high)).any())


def _row(value: Any) -> Floats | None:
    """Finite numbers of a list, None of anything else: whoever checks the whole file says what is wrong with it."""
    if not isinstance(value, list) or not all(isinstance(x, int | float) and math.isfinite(x) for x in value):
        return None
    return np.array(value, dtype=np.float64)


def _robot(document: Document, path: Path, like: str | None) -> Robot:
    """The robot, with a closed-form inverse where its geometry has one."""
    check_document(Joints, document["joints"], f"{path.name}: [joints]")
    try:
        robot = robot_of(document, path.name)
        document["geometry"]["family"] = closed_form_family(robot)
        return robot_of(document, path.name)
    except ConfigError as error:
        remedy = "" if like else "from a robot like it with --like NAME, or "
        told = (
            f"a robot file needs more than the URDF tells; take it {remedy}from a file of the same sections with --with"
        )
        raise ConfigError(f"{told}:\n  {error}") from None


def _plain(value: Any) -> Any:
    """Numbers of a TOML file: lists of floats, rounded to what a float64 is good for."""
    if isinstance(value, list):
        return [_plain(entry) for entry in value]
    array = np.asarray(value, dtype=np.float64)
    rounded: Any = (np.round(array, _DIGITS) + 0.0).tolist()
    return rounded
