"""A model found by identification: what of a robot file it replaces, and what the numbers are worth.

The servo takes masses, centres, friction and torque scales from it, and inertia where fast motion told it, and
compensates gravity on every joint. A model is bound to the robot it was found on: to its name and, by a digest, to
geometry and transmission.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import Field

from qrobot.arrays import Floats
from qrobot.config.document import Table, check_document, config_path, read_document
from qrobot.config.kinds import FileKind
from qrobot.config.robot import DAC_HALF_RANGE, Friction, Robot
from qrobot.config.values import (
    JointKinds,
    PerJoint,
    PerJointInertia,
    PerJointNotNegative,
    PerJointPositive,
    PerJointVectors,
    frozen,
)
from qrobot.errors import ConfigError

PRESET: Final = "identified"
FOLDER: Final = "ident"


class IdentifiedLinks(Table):
    """Masses in kg, centres in m and principal inertias about them in kg·m², axes of the link frames.

    Without motion that accelerates there are no inertias: the robot file's stay.
    """

    mass: PerJointNotNegative
    com: PerJointVectors
    inertia: PerJointInertia | None = None


class IdentifiedFriction(Table):
    """Viscous friction (N·m·s/rad) and Coulomb friction of each direction (N·m) of the motors, in joint units.

    In torque as it is commanded with the robot file's `dac_per_Nm`.
    """

    viscous: PerJointNotNegative
    coulomb_pos: PerJointNotNegative
    coulomb_neg: PerJointNotNegative


class IdentifiedDrives(Table):
    """Torque that each motor has to be commanded, with the robot file's `dac_per_Nm`, for 1 N·m (N) of the links.

    The links' own unit is one motor's commanded torque, or the true N·m where a known load was carried.
    """

    torque_scale: PerJointPositive


class Quality(Table):
    """Error of torques that the servo predicts for passes held back, N·m, and the robot file's; `condition` of the fit.

    `motion_rms` is the error for motion that accelerates, `motion_before_rms` that with the robot file's inertia.
    """

    held_back_rms: PerJoint
    before_rms: PerJoint
    observations: int
    condition: float
    motion_rms: PerJoint | None = None
    motion_before_rms: PerJoint | None = None


class IdentifiedValue(Table):
    """One identified number with the half width of its 95 % interval, and what the robot file says."""

    name: str
    meaning: str
    unit: str
    value: float
    half_width: float
    before: float


class IdentifiedModel(Table):
    """A model of one robot. `date` is that of the measurement, `data` the digest of what was measured.

    `plant` is that of the emulated arm it was found on; "" for a real one.
    """

    robot: str
    robot_digest: str
    date: str
    data: str
    links: IdentifiedLinks
    friction: IdentifiedFriction
    quality: Quality
    plant: str = ""
    drives: IdentifiedDrives | None = None
    value: tuple[IdentifiedValue, ...] = Field(default=(), strict=False)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON and TOML."""
        document = self.model_dump(exclude_none=True)
        plain: dict[str, Any] = json.loads(json.dumps(document, default=np.ndarray.tolist))
        return plain


def robot_digest(robot: Robot) -> str:
    """Digest of what an identified model rests on: joints, geometry and transmission. 16 hexadecimal digits."""
    sections = robot.joints, robot.geometry, robot.transmission
    plain = [section.model_dump(exclude={"source"}) for section in sections]
    return hashlib.sha256(json.dumps(plain, default=np.ndarray.tolist, sort_keys=True).encode()).hexdigest()[:16]


def model_path(name_or_path: str | Path) -> Path:
    """Find a model: a path to a `.toml`, or the name of a packaged one. Raises ConfigError when there is none."""
    return config_path(name_or_path, FileKind.MODEL, FOLDER)


def load_model(name_or_path: str | Path, robot: Robot) -> IdentifiedModel:
    """Load a model, a path to a `.toml` or the name of a packaged one, for a robot.

    Raises:
        ConfigError: no such file, mistakes in it, or it was made for another robot.
    """
    path = model_path(name_or_path)
    document = read_document(path)
    if document.get("robot") != robot.name:
        raise ConfigError(f"{path.name} was identified on robot {document.get('robot')!r}, not on {robot.name!r}")
    model = check_document(IdentifiedModel, document, path.name, JointKinds(robot.prismatic))
    if model.robot_digest != robot_digest(robot):
        raise ConfigError(f"{path.name}: geometry or transmission of {robot.name} changed since: identify it again")
    return model


def with_model(robot: Robot, model: IdentifiedModel) -> Robot:
    """The robot as it was identified: links, friction, torque; gravity is compensated on every joint."""
    scale = np.ones(robot.n) if model.drives is None else model.drives.torque_scale
    links = robot.links.model_copy(update={name: found for name, found in model.links if found is not None})
    believed = robot.friction[robot.control.friction_preset]
    rubs = {name: frozen(commanded / scale) for name, commanded in model.friction}
    friction: Friction = believed.model_copy(update=rubs)
    control = robot.control.model_copy(
        update={"friction_preset": PRESET, "gravity_joints": np.ones(robot.n, dtype=np.bool_)}
    )
    found = robot.model_copy(
        update={"links": links, "friction": {**robot.friction, PRESET: friction}, "control": control}
    )
    return with_torque_scale(found, scale)


def with_torque_scale(robot: Robot, scale: Floats) -> Robot:
    """The robot whose motors have to be commanded `scale` times what its file says for the same torque. Shape (n,).

    The guard allows no more torque than before, and no more than the converter can ask for.
    """
    dac_per_Nm = robot.transmission.dac_per_Nm * scale
    tau_max = np.minimum(robot.guard.tau_max, DAC_HALF_RANGE / np.abs(dac_per_Nm))
    transmission = robot.transmission.model_copy(update={"dac_per_Nm": frozen(dac_per_Nm)})
    guard = robot.guard.model_copy(update={"tau_max": frozen(tau_max)})
    return robot.model_copy(update={"transmission": transmission, "guard": guard})
