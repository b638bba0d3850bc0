"""Writer of the model file that the servo loads, out of an identified model."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any, Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.config.document import check_document
from qrobot.config.identified import IdentifiedModel, robot_digest
from qrobot.config.toml_text import toml_lines
from qrobot.config.values import JointKinds
from qrobot.errors import IdentificationError
from qrobot.ident.fit import NORMAL_95
from qrobot.ident.friction import FRICTION_NAMES
from qrobot.ident.inertia import InertialModel
from qrobot.ident.model import CLEARLY, Identified
from qrobot.ident.physical_gravity import nearest_links
from qrobot.ident.unknowns import OF_LOAD
from qrobot.servo.memory.telemetry import Rows
from qrobot.whole_file import replace_file

SECTIONS: Final = ("links", "friction", "drives", "quality")
HALF_STEP: Final = 0.5  # DAC counts: a smaller error of torque cannot be commanded away
MOST_DOUBT: Final = 0.05  # [A] of a motor's greatest torque: by so much gravity may be in doubt at any pose
DOUBT_POSES, DOUBT_SEED = 500, 1
_DIGITS: Final = 8
_HEAD: Final = """# The servo uses links, friction and drives. Inertia is about the centre, along the axes of the frame:
# products of inertia, like remainders of stiction and drifts of friction, are among the values, and no law has them.
"""


def model_of(
    found: Identified, rows: Rows, date: str, inertial: InertialModel | None = None, plant: str = ""
) -> IdentifiedModel:
    """The model of what was found in `rows`, measured on `date` (YYYY-MM-DD), with inertia or without.

    `plant` is that of an emulated arm, "" for a real one.

    Raises:
        IdentificationError: it would make the servo worse: it predicts held-back passes worse than the robot file
            does, held-back motion worse than the robot file's inertia does, a friction or the load is negative, or no
            bodies have that gravity.
    """
    _need_better(found)
    robot = found.robot
    document = _document(found, date, f"sha256:{hashlib.sha256(rows.tobytes()).hexdigest()[:16]}") | {"plant": plant}
    if inertial is not None:
        _need_better_inertia(inertial)
        _add_inertia(document, inertial)
    return check_document(IdentifiedModel, document, "the identified model", JointKinds(robot.prismatic))


def _document(found: Identified, date: str, data: str) -> dict[str, Any]:
    robot = found.robot
    mass, com = nearest_links(robot, found.base, found.beta)
    return {
        "robot": robot.name,
        "robot_digest": robot_digest(robot),
        "date": date,
        "data": data,
        "links": {"mass": mass.round(_DIGITS).tolist(), "com": com.round(_DIGITS).tolist()},
        "friction": _friction(found.compensated_friction),
        "drives": {"torque_scale": found.scale.round(_DIGITS).tolist()},
        "quality": {
            "held_back_rms": found.held_back_rms.round(_DIGITS).tolist(),
            "before_rms": found.before_rms.round(_DIGITS).tolist(),
            "observations": len(found.observations),
            "condition": round(found.fit.condition, 3),
        },
        "value": [value.model_dump() for value in found.values],
    }


def _friction(friction: Floats) -> dict[str, list[float]]:
    """Friction (n, 3) by its name; what came out below nothing within its interval is none."""
    columns = zip(FRICTION_NAMES, np.maximum(friction, 0.0).T, strict=True)
    return {name: column.round(_DIGITS).tolist() for name, column in columns}


def _add_inertia(document: dict[str, Any], inertial: InertialModel) -> None:
    """Put what motion told in the place of what steady passes did."""
    links = inertial.links
    document["links"] = {name: getattr(links, name).round(_DIGITS).tolist() for name in ("mass", "com", "inertia")}
    document["friction"] = _friction(inertial.friction)
    document["quality"]["motion_rms"] = inertial.held_back_rms.round(_DIGITS).tolist()
    document["quality"]["motion_before_rms"] = inertial.before_rms.round(_DIGITS).tolist()
    document["value"] = [value.model_dump() for value in inertial.values]


def _need_better(found: Identified) -> None:
    robot = found.robot
    _need_a_load_that_weighs(found)
    if unjudged := _named(robot, np.isnan(found.held_back_rms)):
        raise IdentificationError(f"no held-back pass turns {unjudged}: record more poses")
    if worse := _named(robot, found.held_back_rms > _as_good(found)):
        raise IdentificationError(f"the fit predicts {worse} worse than the robot file does: no model is written")
    least = _least_friction(robot, found.unknowns.parts(found.fit.half_width).friction)
    viscous, coulomb = found.friction[:, :1], found.friction[:, 1:]
    if reversed_ := _named(robot, (coulomb < np.minimum(-np.abs(viscous), least[:, 1:])).all(axis=1)):
        raise IdentificationError(
            f"friction of {reversed_} pushes: the sign of its torque is reversed, in the log or in the robot file's "
            "dac_per_Nm"
        )
    if negative := _named(robot, (np.minimum(found.friction, found.compensated_friction) < least).any(axis=1)):
        raise IdentificationError(f"friction of {negative} comes out negative: look at the passes it was recorded in")


def _need_a_load_that_weighs(found: Identified) -> None:
    """Raise IdentificationError when the logs with the load and those without it have changed places."""
    load, first = found.unknowns.load, len(found.base.leading)
    if load is None or load.combination(0) != OF_LOAD[0]:
        return
    mass, half_width = float(found.fit.values[first]), float(found.fit.half_width[first])
    if mass < -CLEARLY * half_width:
        raise IdentificationError(
            f"the load weighs {mass:.2f} ± {half_width:.2f} kg: --loaded names the logs that were recorded with it, "
            "and seems to name those without it. Change them round"
        )


def require_gravity_everywhere(found: Identified) -> None:
    """Raise IdentificationError when the passes were too much alike to tell gravity at other poses.

    For a model that is to carry the arm; friction and a page may be looked at all the same.
    """
    worst = gravity_doubt(found).max(axis=0)
    allowed = MOST_DOUBT * found.robot.guard.tau_max + _half_step(found.robot)
    if named := _named(found.robot, worst > allowed):
        motor = int(np.argmax(worst / allowed))
        raise IdentificationError(
            f"gravity of {named} is hardly told away from the poses of the logs: ± {worst[motor]:.1f} at the worst for "
            f"{found.robot.joint_names[motor]}, and {allowed[motor]:.1f} N m (N) are allowed. Record the whole plan of "
            "`qrobot identify plan`"
        )


def doubt_poses(robot: Robot) -> Floats:
    """Poses all over the range, the same at each call. Shape (DOUBT_POSES, n)."""
    limits = robot.limits
    return np.random.default_rng(DOUBT_SEED).uniform(limits.q_min, limits.q_max, (DOUBT_POSES, robot.n))


def gravity_doubt(found: Identified) -> Floats:
    """Half widths of the 95 % intervals of the motors' torques that hold the arm, at poses all over its range.

    Returns:
        N m (N), of each pose and motor. Shape (DOUBT_POSES, n).
    """
    robot, b = found.robot, len(found.base.leading)
    of_joints = found.base.columns(found.regressor(doubt_poses(robot)))
    of_motors = np.einsum("mjb,ji->mib", of_joints, np.linalg.inv(robot.transmission.coupling))
    variance = np.einsum("mib,bc,mic->mi", of_motors, found.fit.covariance[:b, :b], of_motors)
    return np.asarray(NORMAL_95 * np.sqrt(np.maximum(variance, 0.0)))


def _as_good(found: Identified) -> Floats:
    """Error of a prediction up to which a model is no worse than the robot file. Shape (n,).

    A model that equals the file within its own uncertainty, and within what the converter can ask for, errs by no more
    than all three together.
    """
    return np.asarray(found.before_rms + CLEARLY * found.held_back_doubt + _half_step(found.robot))


def _half_step(robot: Robot) -> Floats:
    """Torque of half a step of the converter, by motor, N m (N). Shape (n,)."""
    return np.asarray(HALF_STEP / np.abs(robot.transmission.dac_per_Nm))


def _least_friction(robot: Robot, half_width: Floats) -> Floats:
    """Friction down to which a motor may have none: twice its half width below 0, and more than can be commanded.

    Args:
        robot: the robot file.
        half_width: of the intervals of viscous friction and of Coulomb's. Shape (n, 3).
    """
    smallest = _half_step(robot)
    fastest = np.abs(robot.transmission.coupling) @ robot.limits.v_max
    return np.asarray(-CLEARLY * half_width - np.column_stack([smallest / fastest, smallest, smallest]))


def _need_better_inertia(inertial: InertialModel) -> None:
    robot = inertial.steady.robot
    if unjudged := _named(robot, np.isnan(inertial.held_back_rms)):
        raise IdentificationError(f"no held-back motion turns {unjudged}: record the whole plan")
    if worse := _named(robot, inertial.held_back_rms > inertial.before_rms + _half_step(robot)):
        raise IdentificationError(f"inertia as found predicts {worse} worse than the robot file's: no model is written")
    half_width = inertial.fit.half_width[len(inertial.base.leading) :].reshape(inertial.friction.shape)
    if negative := _named(robot, (inertial.friction < _least_friction(robot, half_width)).any(axis=1)):
        raise IdentificationError(f"friction of {negative} comes out negative in fast motion: is it the same arm?")


def _named(robot: Robot, which: Any) -> str:
    return ", ".join(np.array(robot.joint_names)[which])


def write_model(path: Path, model: IdentifiedModel) -> None:
    """Write a model as TOML. Raises IdentificationError when the file cannot be written."""
    plain = model.to_dict()
    tables = [f"[{name}]\n{toml_lines(plain.pop(name))}" for name in SECTIONS if name in plain]
    values = [f"[[value]]\n{toml_lines(value)}" for value in plain.pop("value")]
    head = (
        f"# Identified model of {model.robot}; written by `qrobot identify fit`, used as [arm.servo] model.\n{_HEAD}\n"
    )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, head + "\n".join([toml_lines(plain), *tables, *values]))
    except OSError as error:
        raise IdentificationError(f"cannot write the model to {path}: {error.strerror}") from error
