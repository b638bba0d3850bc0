"""A URDF as a tree of links and joints: the XML checked, and no robot made of it yet.

Facts of the format: the pages urdf/XML/link and urdf/XML/joint of wiki.ros.org. Lengths are metres, angles radians;
`rpy` turns about the fixed axes x, y and z in this order. What only a viewer wants is not read.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import ConfigError
from qrobot.model.transform import rpy, transform

Element = ElementTree.Element

TURNING: Final = ("revolute", "continuous")
MOVING: Final = (*TURNING, "prismatic")
KNOWN_KINDS: Final = (*MOVING, "fixed")
LARGEST_FILE: Final = 16_000_000  # [A] bytes
LARGEST_NUMBER: Final = 1e20  # [A]; some files have ranges of 1e16
LONGEST_NAME: Final = 100  # [A] characters
MOST_LISTED: Final = 20  # [A] names in a message


@dataclass(frozen=True, eq=False)
class LinkBody:
    """Mass in kg, centre in m, inertia about the centre in kg·m², all in the axes of the link. Shapes (3,), (3, 3)."""

    mass: float
    com: Floats
    inertia: Floats


@dataclass(frozen=True, eq=False)
class UrdfJoint:
    """One joint: the child's frame in the parent's at zero, and the axis in the child's frame.

    Attributes:
        T_parent_child: shape (4, 4).
        axis: unit vector. Shape (3,).
        lower, upper: rad (m); None where the file gives no range.
        velocity, effort: rad/s (m/s), N·m (N); None where the file gives none.
        damping, friction: N·m·s/rad (N·s/m), N·m (N).
        follows: the joint that it is geared to (`<mimic>`); empty for none.
    """

    name: str
    kind: str
    parent: str
    child: str
    T_parent_child: Floats
    axis: Floats
    lower: float | None = None
    upper: float | None = None
    velocity: float | None = None
    effort: float | None = None
    damping: float = 0.0
    friction: float = 0.0
    follows: str = ""

    @property
    def moves(self) -> bool:
        """True of a joint that turns or slides."""
        return self.kind in MOVING


@dataclass(frozen=True, eq=False)
class UrdfTree:
    """All of a URDF that this project reads. `bodies` has every link by name, without mass where none is given."""

    name: str
    root: str
    bodies: dict[str, LinkBody]
    joints: tuple[UrdfJoint, ...]

    @cached_property
    def below(self) -> dict[str, list[UrdfJoint]]:
        """The joints below each link that has some."""
        return _below(self.joints)

    @property
    def leaves(self) -> tuple[str, ...]:
        """Links that carry no other."""
        return tuple(link for link in self.bodies if link not in self.below)


class _PlainBuilder(ElementTree.TreeBuilder):
    """Builds the elements of a file without a document type: entities that it declares may have no end."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path

    def doctype(self, name: str, *_: str | None) -> None:
        """Raise ConfigError; the parser calls this before it reads what is declared."""
        what = f"declares a document type, <!DOCTYPE {name[:60]} ...>"
        raise ConfigError(f"{self._path}: {what}; a URDF needs none: take it out")


def read_urdf(path: Path) -> UrdfTree:
    """Read a URDF.

    Raises:
        ConfigError: it cannot be read, is no URDF, or its links are no tree; names the element.
    """
    try:
        with path.open("rb") as file:
            text = file.read(LARGEST_FILE + 1)
        if len(text) > LARGEST_FILE:
            raise ConfigError(f"{path}: larger than {LARGEST_FILE // 1_000_000} MB; is it a URDF?")
        root = ElementTree.fromstring(text, ElementTree.XMLParser(target=_PlainBuilder(path)))
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}") from error
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # an encoding that nobody knows
        raise ConfigError(f"{path}: not XML: {error}") from None
    if root.tag != "robot":
        hint = "; expand it first: xacro FILE > robot.urdf" if "xacro" in str(root.tag) else ""
        raise ConfigError(f"{path}: a URDF begins with <robot>, this with <{root.tag}>{hint}")
    _refuse_xacro(root, path)
    return _tree(root, path)


def _refuse_xacro(root: Element, path: Path) -> None:
    if any("xacro" in str(element.tag) for element in root.iter()):
        raise ConfigError(f"{path}: has macros of xacro; expand them first: xacro FILE > robot.urdf")


def _tree(root: Element, path: Path) -> UrdfTree:
    links, joints = root.findall("link"), root.findall("joint")
    for what, elements in (("link", links), ("joint", joints)):
        names = [_name(element, path) for element in elements]
        if twice := [name for name, times in Counter(names).items() if times > 1]:
            raise ConfigError(f"{path}: two {what}s are called {min(twice)!r}")
    bodies = {_name(link, path): _body(link, path) for link in links}
    made = tuple(_joint(joint, path) for joint in joints)
    return UrdfTree(root.get("name", path.stem), _root(path, bodies, made), bodies, made)


def _root(path: Path, bodies: dict[str, LinkBody], joints: tuple[UrdfJoint, ...]) -> str:
    """The one link that hangs on no joint, from which every other one is reached."""
    children = Counter(joint.child for joint in joints)
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in bodies:
                raise ConfigError(f"{path}: joint {joint.name!r} speaks of link {link!r}, which is not in the file")
        if children[joint.child] > 1:
            raise ConfigError(f"{path}: link {joint.child!r} hangs on two joints: a closed chain is no serial arm")
    roots = [link for link in bodies if link not in children]
    if len(roots) != 1:
        raise ConfigError(f"{path}: one link must hang on no joint, here there are: {listed(roots) or 'none'}")
    if circle := set(bodies) - _reached(roots[0], joints):
        raise ConfigError(f"{path}: joints go round in a circle, so that {sorted(circle)[0]!r} hangs on itself")
    return roots[0]


def _reached(root: str, joints: tuple[UrdfJoint, ...]) -> set[str]:
    """The links below `root`, itself too."""
    below, reached, newest = _below(joints), {root}, [root]
    while newest:
        newest = [joint.child for link in newest for joint in below.get(link, ()) if joint.child not in reached]
        reached.update(newest)
    return reached


def _below(joints: tuple[UrdfJoint, ...]) -> dict[str, list[UrdfJoint]]:
    """The joints by the names of their parents."""
    below: dict[str, list[UrdfJoint]] = {}
    for joint in joints:
        below.setdefault(joint.parent, []).append(joint)
    return below


def listed(names: Sequence[str]) -> str:
    """Names for a message, the first of them if they are many."""
    more = f" and {len(names) - MOST_LISTED} more" if len(names) > MOST_LISTED else ""
    return ", ".join(name[:60] for name in names[:MOST_LISTED]) + more


def _body(link: Element, path: Path) -> LinkBody:
    inertial = link.find("inertial")
    if inertial is None:
        return LinkBody(0.0, np.zeros(3), np.zeros((3, 3)))
    where = f"link {_name(link, path)!r}"
    T = _origin(inertial, path, where)
    mass = _number(inertial.find("mass"), "value", path, where)
    if mass < 0.0:
        raise ConfigError(f"{path}: {where}: its mass is {mass:g}, and below zero")
    tensor = _tensor(inertial.find("inertia"), path, where)
    return LinkBody(mass, T[:3, 3].copy(), T[:3, :3] @ tensor @ T[:3, :3].T)


def _tensor(element: Element | None, path: Path, where: str) -> Floats:
    xx, xy, xz, yy, yz, zz = (_number(element, key, path, where) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _joint(joint: Element, path: Path) -> UrdfJoint:
    name = _name(joint, path)
    where = f"joint {name!r}"
    if (kind := joint.get("type", "")) not in KNOWN_KINDS:
        raise ConfigError(f"{path}: {where} is {kind or 'of no type'}; a serial arm has {', '.join(KNOWN_KINDS)}")
    axis = np.array([1.0, 0.0, 0.0]) if (given := joint.find("axis")) is None else _vector(given, "xyz", path, where)
    axis = axis / (np.abs(axis).max() or 1.0)  # the square of what is very large or small is no number
    if kind in MOVING and not (length := float(np.linalg.norm(axis))) > 0.0:
        raise ConfigError(f"{path}: {where}: its axis has no direction")
    limit, dynamics, mimic = joint.find("limit"), joint.find("dynamics"), joint.find("mimic")
    return UrdfJoint(
        name=name,
        kind=kind,
        parent=_link_of(joint, "parent", path, where),
        child=_link_of(joint, "child", path, where),
        T_parent_child=_origin(joint, path, where),
        axis=axis / length if kind in MOVING else axis,
        lower=_optional(limit, "lower", path, where),
        upper=_optional(limit, "upper", path, where),
        velocity=_optional(limit, "velocity", path, where),
        effort=_optional(limit, "effort", path, where),
        damping=_optional(dynamics, "damping", path, where) or 0.0,
        friction=_optional(dynamics, "friction", path, where) or 0.0,
        follows="" if mimic is None else mimic.get("joint", "another"),
    )


def _name(element: Element, path: Path) -> str:
    if not (name := element.get("name", "").strip()):
        raise ConfigError(f"{path}: a <{element.tag}> has no name")
    if not name.isprintable() or len(name) > LONGEST_NAME:
        raise ConfigError(f"{path}: a <{element.tag}> is called {name[:60]!r}, which is too long or cannot be printed")
    return name


def _link_of(joint: Element, which: str, path: Path, where: str) -> str:
    element = joint.find(which)
    if element is None or not (link := element.get("link", "").strip()):
        raise ConfigError(f"{path}: {where} names no {which} link")
    return link


def _origin(element: Element, path: Path, where: str) -> Floats:
    """The `<origin>` of an element; identity where there is none. Shape (4, 4)."""
    if (origin := element.find("origin")) is None:
        return np.eye(4)
    roll, pitch, yaw = _vector(origin, "rpy", path, where) if origin.get("rpy") else np.zeros(3)
    place = _vector(origin, "xyz", path, where) if origin.get("xyz") else np.zeros(3)
    return transform(rpy(float(yaw), float(pitch), float(roll)), place)


def _vector(element: Element, key: str, path: Path, where: str) -> Floats:
    words = element.get(key, "").split()
    numbers = [_finite(word) for word in words]
    if len(numbers) != 3 or any(number is None for number in numbers):
        raise ConfigError(
            f"{path}: {where}: {key} must be three numbers, up to {LARGEST_NUMBER:g}, is {' '.join(words)[:60]!r}"
        )
    return np.array(numbers, dtype=np.float64)


def _number(element: Element | None, key: str, path: Path, where: str) -> float:
    number = _optional(element, key, path, where)
    if number is None:
        raise ConfigError(f"{path}: {where}: {key} is missing")
    return number


def _optional(element: Element | None, key: str, path: Path, where: str) -> float | None:
    word = None if element is None else element.get(key)
    if word is None:
        return None
    if (number := _finite(word)) is None:
        raise ConfigError(f"{path}: {where}: {key} must be a number, up to {LARGEST_NUMBER:g}, is {word[:60]!r}")
    return number


def _finite(word: str) -> float | None:
    """The number of a word as XML writes them; None for others, and for what squares of lengths would make infinite."""
    try:
        number = float(word) if word.isascii() and "_" not in word else math.nan
    except ValueError:
        return None
    return number if abs(number) <= LARGEST_NUMBER else None
