"""A robot as the text of its file: TOML with every value beside its source."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config.robot import Robot
from qrobot.config.toml_text import toml_key, toml_lines
from qrobot.errors import ConfigError
from qrobot.printable import printable
from qrobot.units import DEG_PER_RAD
from qrobot.whole_file import replace_file

Document = dict[str, Any]

_TURNED: Final = {"q_min_deg", "q_max_deg", "v_max_deg_s", "q_offset_deg"}
"""Keys in degrees on joints that turn, and in metres on those that slide."""
_ORDER: Final = (
    "joints",
    "geometry",
    "limits",
    "poses",
    "transmission",
    "links",
    "friction",
    "control",
    "guard",
    "board",
    "shape",
)
"""Sections, as they stand in a file; others come after them."""
_UNITS: Final = "# SI units, one entry per joint; keys ending in _deg or _deg_s are degrees on joints that turn."
_DIGITS: Final = 12  # behind the point, in degrees: radians come back to 2e-14


def robot_document(robot: Robot) -> Document:
    """The document that `robot_of` makes this robot of."""
    document = robot.model_dump(by_alias=True, exclude_unset=True)
    document["poses"] = {"source": robot.pose_section.source} | {
        name: _in_file_units(pose, robot) for name, pose in robot.poses.items()
    }
    document["geometry"]["alpha_deg"] = robot.geometry.alpha_rad * DEG_PER_RAD
    document["geometry"]["theta_deg"] = robot.geometry.theta_rad * DEG_PER_RAD
    for section in ("limits", "transmission"):
        for key in _TURNED & set(document[section]):
            document[section][key] = _in_file_units(document[section][key], robot)
    document["transmission"]["coupling"] = _coefficients(robot.transmission.coupling)
    plain: Document = _plain(document)
    return plain


def write_robot(path: Path, document: Document) -> None:
    """Write a robot file. Raises ConfigError when that fails."""
    try:
        replace_file(path, robot_text(document))
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror}") from error


def robot_text(document: Document) -> str:
    """A robot file of a document."""
    told = (document.get("about") or document["name"]).splitlines()
    about = "".join(f"# {printable(line)}\n" for line in told) + f"#\n{_UNITS}\n"
    heads = toml_lines({key: value for key, value in document.items() if not isinstance(value, dict)})
    sections = [name for name in dict.fromkeys((*_ORDER, *document)) if isinstance(document.get(name), dict)]
    tables = [_table_text(name, document[name]) for name in sections]
    return "\n".join([about, heads, *tables])


def _table_text(path: str, table: Document) -> str:
    """A table, those inside of it after it; the coupling stays in one line."""
    inside = {key: value for key, value in table.items() if isinstance(value, dict) and key != "coupling"}
    own = {key: value for key, value in table.items() if key not in inside}
    parts = [f"[{path}]\n{toml_lines(own)}"] if own else []
    return "\n".join([*parts, *(_table_text(f"{path}.{toml_key(key)}", value) for key, value in inside.items())])


def _in_file_units(values: Floats, robot: Robot) -> Floats:
    return np.where(robot.prismatic, values, values * DEG_PER_RAD)


def _coefficients(coupling: Floats) -> dict[str, float]:
    """The `k<motor><joint>` of a coupling matrix C: the other entries of its inverse, with their signs changed."""
    inverse = np.linalg.inv(coupling)
    n = len(coupling)
    pairs = ((motor, joint) for motor in range(n) for joint in range(n) if motor != joint)
    return {f"k{i + 1}{j + 1}": -float(inverse[j, i]) for i, j in pairs if abs(inverse[j, i]) > 1e-14}


def _plain(value: Any) -> Any:
    """Lists and numbers in place of arrays and tuples."""
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray):
        value = np.round(value, _DIGITS) + 0.0 if value.dtype.kind == "f" else value
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return round(value, _DIGITS) if isinstance(value, float) else value
