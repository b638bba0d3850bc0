"""The one chain of moving joints from a URDF's root to a tip, with everything that is bolted on merged into its links.

Every frame is turned so that its z is the axis of its joint; the joint then moves about (along) z of its own frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import reduce
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import ConfigError
from qrobot.exchange.urdf_document import LinkBody, UrdfJoint, UrdfTree, listed
from qrobot.model.transform import inverse, so3_exp, transform
from qrobot.wire.vocabulary import MAX_JOINTS

_NO_BODY: Final = LinkBody(0.0, np.zeros(3), np.zeros((3, 3)))


@dataclass(frozen=True, eq=False)
class ChainLink:
    """One moving joint and what it carries up to the next.

    Attributes:
        joint: as the file has it.
        T_previous_joint: this joint's frame in the one before it (of the first: in its parent link), at zero. (4, 4).
        body: in this joint's frame.
    """

    joint: UrdfJoint
    T_previous_joint: Floats
    body: LinkBody


@dataclass(frozen=True, eq=False)
class SerialChain:
    """A serial arm as a URDF tells it.

    `T_root_base` is the parent link of the first moving joint in the root link, `T_last_tip` the tip link in the last
    joint's frame. Shapes (4, 4).
    """

    name: str
    T_root_base: Floats
    links: tuple[ChainLink, ...]
    T_last_tip: Floats
    stiffened: tuple[str, ...]
    """Moving joints beside the chain, of a gripper for instance, which are taken as fixed at zero."""


def serial_chain(tree: UrdfTree, tip: str | None = None) -> SerialChain:
    """The chain from the root to `tip`, or to the only link that carries no other.

    Raises:
        ConfigError: no such link, several tips to choose from, none or too many joints that move, or one that follows
            another.
    """
    joints = _joints_to(tree, _tip(tree, tip))
    moving = sum(joint.moves for joint in joints)
    if not 0 < moving <= MAX_JOINTS:
        how_many = f"{moving} joints move" if moving else "no joint moves"
        raise ConfigError(f"{tree.name}: {how_many} between {tree.root!r} and the tip; 1 to {MAX_JOINTS} can")
    chain_names = {joint.name for joint in joints}
    _refuse_mimics(tree, joints)
    first = next(number for number, joint in enumerate(joints) if joint.moves)
    T_root_base = reduce(np.matmul, (joint.T_parent_child for joint in joints[:first]), np.eye(4))
    links: list[ChainLink] = []
    place = np.eye(4)  # of the link at hand in the frame of the last moving joint
    for joint in joints[first:]:
        place = place @ joint.T_parent_child
        if joint.moves:
            turn = transform(_z_to(joint.axis))
            body = _merged(tree, joint.child, inverse(turn), chain_names)
            links.append(ChainLink(joint, place @ turn, body))
            place = inverse(turn)
    stiffened = tuple(j.name for j in tree.joints if j.moves and j.name not in chain_names)
    return SerialChain(tree.name, T_root_base, tuple(links), place, stiffened)


def _refuse_mimics(tree: UrdfTree, joints: list[UrdfJoint]) -> None:
    """Raise ConfigError for a joint of the chain that has no motor of its own; a gripper's fingers do no harm."""
    for joint in joints:
        if joint.moves and joint.follows:
            raise ConfigError(
                f"{tree.name}: joint {joint.name!r} follows joint {joint.follows!r} (<mimic>); each joint of a"
                " serial arm has a motor of its own: choose a --tip before it, or make it fixed"
            )


def _tip(tree: UrdfTree, tip: str | None) -> str:
    if tip is None:
        if len(tree.leaves) == 1:
            return tree.leaves[0]
        raise ConfigError(f"{tree.name} has several ends; name one with --tip: {listed(tree.leaves)}")
    if tip not in tree.bodies:
        raise ConfigError(f"{tree.name} has no link {tip!r}; its ends are {listed(tree.leaves)}")
    return tip


def _joints_to(tree: UrdfTree, tip: str) -> list[UrdfJoint]:
    """The joints from the root to a link."""
    by_child = {joint.child: joint for joint in tree.joints}
    path: list[UrdfJoint] = []
    while tip != tree.root:
        path.append(by_child[tip])
        tip = by_child[tip].parent
    return path[::-1]


def _merged(tree: UrdfTree, link: str, place: Floats, chain: set[str]) -> LinkBody:
    """The link and all that hangs on it without a joint of the chain; `place` is the link in the frame asked for."""
    bodies = list(_bodies(tree, link, place, chain))
    mass = sum(body.mass for body in bodies)
    if mass <= 0.0:
        return _NO_BODY
    com = sum((body.mass * body.com for body in bodies), np.zeros(3)) / mass
    inertia = sum((body.inertia + _steiner(body.mass, body.com - com) for body in bodies), np.zeros((3, 3)))
    return LinkBody(mass, com, inertia)


def _bodies(tree: UrdfTree, link: str, place: Floats, chain: set[str]) -> Iterator[LinkBody]:
    waiting = [(link, place)]
    while waiting:
        link, place = waiting.pop()
        own, R = tree.bodies[link], place[:3, :3]
        yield LinkBody(own.mass, R @ own.com + place[:3, 3], R @ own.inertia @ R.T)
        below = [joint for joint in tree.below.get(link, ()) if not (joint.moves and joint.name in chain)]
        waiting += [(joint.child, place @ joint.T_parent_child) for joint in reversed(below)]


def _steiner(mass: float, arm: Floats) -> Floats:
    """Inertia that a mass adds about a point at `arm` from it. Shape (3, 3)."""
    return np.asarray(mass * (arm @ arm * np.eye(3) - np.outer(arm, arm)))


def _z_to(axis: Floats) -> Floats:
    """The smallest rotation that takes z to the unit vector `axis`. Shape (3, 3)."""
    z = np.array([0.0, 0.0, 1.0])
    normal = np.cross(z, axis)
    sine, cosine = float(np.linalg.norm(normal)), float(axis @ z)
    if sine < 1e-12:
        return np.eye(3) if cosine > 0.0 else np.diag([1.0, -1.0, -1.0])
    return so3_exp(normal / sine * np.arctan2(sine, cosine))
