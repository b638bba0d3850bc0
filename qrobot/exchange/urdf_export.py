"""A robot as a URDF: its link frames as they stand in the Denavit-Hartenberg table, with simple shapes to look at.

What a URDF cannot say is left out: coupling of the wrist, gears, accelerations. Of Coulomb friction that differs by
direction it has the mean.
"""

from __future__ import annotations

from typing import Final
from xml.etree import ElementTree

import numpy as np

from qrobot.arrays import Floats
from qrobot.config.robot import Robot
from qrobot.exchange.urdf_document import Element
from qrobot.model.transform import so3_exp

ROOT, BASE, TIP = "world", "base", "tool0"  # as robots of ROS have them; no joint makes a link of these names
_RADIUS_M: Final = 0.05  # [A] of the first link's shape; each next one is a tenth thinner
_SHORTEST_M: Final = 1e-3  # [A] what is shorter has no shape
_ROUNDING: Final = 1e-15


def urdf_text(robot: Robot) -> str:
    """A URDF of `robot`: links `world`, `base`, one named after each joint, and `tool0` at the flange."""
    root = ElementTree.Element("robot", name=robot.name)
    ElementTree.SubElement(root, "link", name=ROOT)
    base = ElementTree.SubElement(root, "link", name=BASE)
    _add_shape(base, _to_next(robot, 0), 0)
    _add_fixed(root, ROOT, BASE, [0.0, 0.0, robot.geometry.base_height_m])
    for i in range(robot.n):
        _add_link(root, robot, i)
        _add_joint(root, robot, i)
    ElementTree.SubElement(root, "link", name=TIP)
    _add_fixed(root, link_name(robot, robot.n - 1), TIP, [0.0, 0.0, robot.geometry.flange_m])
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="utf-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'


def link_name(robot: Robot, i: int) -> str:
    """Name of the link that joint i moves."""
    return f"{robot.joint_names[i]}_link"


def _add_fixed(root: Element, parent: str, child: str, place: list[float]) -> None:
    joint = ElementTree.SubElement(root, "joint", name=f"{child}_mount", type="fixed")
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    ElementTree.SubElement(joint, "origin", xyz=_words(place), rpy="0 0 0")


def _add_joint(root: Element, robot: Robot, i: int) -> None:
    geometry, limits = robot.geometry, robot.limits
    kind = "prismatic" if robot.prismatic[i] else "revolute"
    joint = ElementTree.SubElement(root, "joint", name=robot.joint_names[i], type=kind)
    ElementTree.SubElement(joint, "parent", link=BASE if i == 0 else link_name(robot, i - 1))
    ElementTree.SubElement(joint, "child", link=link_name(robot, i))
    alpha, theta = float(geometry.alpha_rad[i]), float(geometry.theta_rad[i])
    # Rx(alpha) Rz(theta) as turns about fixed axes, x first: Rz(yaw) Ry(pitch) Rx(roll).
    R = so3_exp([alpha, 0.0, 0.0]) @ so3_exp([0.0, 0.0, theta])
    ElementTree.SubElement(joint, "origin", xyz=_words(_row_origin(robot, i)), rpy=_words(_roll_pitch_yaw(R)))
    ElementTree.SubElement(joint, "axis", xyz="0 0 1")
    limit = {"lower": limits.q_min[i], "upper": limits.q_max[i]}
    limit |= {"velocity": limits.v_max[i], "effort": robot.guard.tau_max[i]}
    ElementTree.SubElement(joint, "limit", {key: _words([value]) for key, value in limit.items()})
    friction = robot.friction[robot.control.friction_preset]
    dry = 0.5 * (friction.coulomb_pos[i] + friction.coulomb_neg[i])
    dynamics = {"damping": _words([friction.viscous[i]]), "friction": _words([dry])}
    ElementTree.SubElement(joint, "dynamics", dynamics)


def _add_link(root: Element, robot: Robot, i: int) -> None:
    links = robot.links
    link = ElementTree.SubElement(root, "link", name=link_name(robot, i))
    inertial = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(inertial, "origin", xyz=_words(links.com[i]), rpy="0 0 0")
    ElementTree.SubElement(inertial, "mass", value=_words([links.mass[i]]))
    moments = dict(zip(("ixx", "iyy", "izz"), links.inertia[i], strict=True)) | dict.fromkeys(
        ("ixy", "ixz", "iyz"), 0.0
    )
    ElementTree.SubElement(inertial, "inertia", {key: _words([value]) for key, value in moments.items()})
    _add_shape(link, _to_next(robot, i + 1), i + 1)


def _to_next(robot: Robot, i: int) -> Floats:
    """Vector from a frame to frame i, that of the next joint at zero, or to the flange. Shape (3,)."""
    return np.array([0.0, 0.0, robot.geometry.flange_m]) if i == robot.n else _row_origin(robot, i)


def _row_origin(robot: Robot, i: int) -> Floats:
    """Origin of frame i in frame i - 1 at zero. Shape (3,)."""
    geometry = robot.geometry
    alpha, d = geometry.alpha_rad[i], geometry.d_m[i]
    return np.array([geometry.a_m[i], -np.sin(alpha) * d, np.cos(alpha) * d])


def _add_shape(link: Element, reach: Floats, number: int) -> None:
    """A cylinder from the frame of a link, the base being number 0, to the next one."""
    length = float(np.linalg.norm(reach))
    if length < _SHORTEST_M:
        return
    visual = ElementTree.SubElement(link, "visual")
    turn = [0.0, float(np.arctan2(np.hypot(*reach[:2]), reach[2])), float(np.arctan2(reach[1], reach[0]))]
    ElementTree.SubElement(visual, "origin", xyz=_words(0.5 * reach), rpy=_words(turn))
    shape = ElementTree.SubElement(visual, "geometry")
    ElementTree.SubElement(shape, "cylinder", radius=_words([_RADIUS_M * 0.9**number]), length=_words([length]))


def _roll_pitch_yaw(R: Floats) -> list[float]:
    """Turns about the fixed axes x, y, z. At a pitch of a quarter turn yaw is taken as zero."""
    pitch = float(np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0])))
    if np.hypot(R[0, 0], R[1, 0]) < 1e-12:
        return [float(np.arctan2(-R[1, 2], R[1, 1])), pitch, 0.0]
    return [float(np.arctan2(R[2, 1], R[2, 2])), pitch, float(np.arctan2(R[1, 0], R[0, 0]))]


def _words(numbers: Floats | list[float]) -> str:
    """Numbers to their last digit; rounding about zero is zero."""
    return " ".join(f"{0.0 if abs(number) < _ROUNDING else float(number)!r}" for number in numbers)
