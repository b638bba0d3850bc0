"""The data base of robots for RCI in C: the robot files at joint level, as a C source of constants."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from qrobot.config import Robot, load_robot, robot_path
from qrobot.errors import ConfigError
from qrobot.motion import motion_limits

PACKAGED: Final = ("puma560", "stanford")
TABLE_MAKER: Final = Path(__file__)
"""This file: a table made by another version of it is another table."""
_NAMES: Final = (
    "q_min", "q_max", "v_max", "a_max", "tau_max", "q_offset", "rad_per_count", "count_offset", "counts_per_rev",
    "dac_per_Nm", "coupling", "uncoupling",
)  # fmt: skip


def robot_files() -> list[Path]:
    """Files of the packaged robots."""
    return [robot_path(name) for name in PACKAGED]


def robot_table(files: Sequence[Path]) -> str:
    """The source of `rci_robot_table`. Raises ConfigError for a mistake in a file, or two robots of one name."""
    robots = [load_robot(path) for path in files]
    names = [robot.name for robot in robots]
    if twice := {name for name in names if names.count(name) > 1}:
        raise ConfigError(
            f"two robots of the name {', '.join(sorted(twice))}: `name` in the robot file tells them apart"
        )
    arrays = [line for i, robot in enumerate(robots) for line in _arrays(i, robot)]
    entries = [_entry(i, robot, path) for i, (robot, path) in enumerate(zip(robots, files, strict=True))]
    table = ",\n".join(entries)
    return "\n".join(
        (
            '#include "rci.h"',
            "extern const RCI_ROBOT rci_robot_table[];",
            "extern const int rci_robot_count;",
            *arrays,
            f"const RCI_ROBOT rci_robot_table[] = {{\n{table}\n}};",
            f"const int rci_robot_count = {len(robots)};",
            "",
        )
    )


def _numbers_of(robot: Robot) -> tuple[NDArray[np.generic], ...]:
    """Values of the arrays named in `_NAMES`, in that order."""
    limits, t = motion_limits(robot), robot.transmission
    return (
        limits.q_min, limits.q_max, limits.v_max, limits.a_max, robot.guard.tau_max, t.q_offset, t.rad_per_count,
        np.asarray(t.count_offset), np.asarray(t.counts_per_rev), t.dac_per_Nm, t.coupling, np.linalg.inv(t.coupling),
    )  # fmt: skip


def _arrays(i: int, robot: Robot) -> list[str]:
    lines = []
    for name, values in zip(_NAMES, _numbers_of(robot), strict=True):
        kind = "long" if values.dtype.kind in "iu" else "double"
        words = ", ".join(repr(value) for value in values.ravel().tolist())
        lines.append(f"static const {kind} {name}_{i}[] = {{{words}}};")
    return lines


def _entry(i: int, robot: Robot, path: Path) -> str:
    fields = ", ".join(f"{name}_{i}" for name in _NAMES)
    return f"    {{{json.dumps(robot.name)}, {json.dumps(str(path))}, {robot.n}, {fields}}}"
