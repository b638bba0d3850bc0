"""The Denavit-Hartenberg table of a robot as text: CSV for programs."""

from __future__ import annotations

import numpy as np

from qrobot.config.robot import Robot
from qrobot.printable import csv_line
from qrobot.units import DEG_PER_RAD

COLUMNS = ("joint", "kind", "alpha_deg", "a_m", "theta_deg", "d_m", "q_min", "q_max", "unit")


def table_rows(robot: Robot) -> list[tuple[str, ...]]:
    """A row of `COLUMNS` for each joint: modified rows (Craig), and the joint's range in degrees or metres."""
    g, scale = robot.geometry, np.where(robot.prismatic, 1.0, DEG_PER_RAD)
    numbers = np.column_stack(
        [
            *(g.alpha_rad * DEG_PER_RAD, g.a_m, g.theta_rad * DEG_PER_RAD, g.d_m),
            *(robot.limits.q_min * scale, robot.limits.q_max * scale),
        ]
    )
    units = np.where(robot.prismatic, "m", "deg")
    words = ([f"{number:.10g}" for number in np.round(row, 10) + 0.0] for row in numbers)
    return [
        (name, kind, *row, str(unit))
        for name, kind, row, unit in zip(robot.joint_names, robot.joints.kinds, words, units, strict=True)
    ]


def csv_text(robot: Robot) -> str:
    """The table as CSV, and the frames before and behind it as comments."""
    g = robot.geometry
    gravity = " ".join(f"{x:g}" for x in g.gravity_m_s2)
    head = [
        f"# {robot.name}: modified Denavit-Hartenberg rows (Craig): Rx(alpha) Tx(a) Rz(theta) Tz(d)",
        "# q adds to theta of a revolute joint, to d of a prismatic one",
        f"# base_height_m {g.base_height_m:g}, flange_m {g.flange_m:g} along the last z, gravity_m_s2 {gravity}",
    ]
    return "\n".join([*head, *(csv_line(row) for row in (COLUMNS, *table_rows(robot))), ""])
