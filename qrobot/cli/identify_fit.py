"""The common part of `qrobot identify fit` and `report`: from logs and options to an identified model."""

from __future__ import annotations

import time
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
from rich.table import Table

from qrobot.arrays import Floats
from qrobot.cli.console import plain_table
from qrobot.cli.identify_options import FitOptions, FrictionTermName
from qrobot.cli.identify_record import read_rows
from qrobot.config import Robot, load_robot
from qrobot.config.identified import IdentifiedModel, robot_digest
from qrobot.errors import ConfigError
from qrobot.ident.model import Identified
from qrobot.ident.result import model_of
from qrobot.ident.session import identify_log, inertia_of_log
from qrobot.ident.stribeck import StribeckFit
from qrobot.log.header import LogHeader
from qrobot.servo.memory.telemetry import Rows

DATE_FORMAT: Final = "%Y-%m-%d"


@dataclass(frozen=True)
class IdentificationTask:
    """Logs and options of one identification."""

    logs: tuple[Path, ...]
    options: FitOptions

    def identified(self) -> tuple[Identified, IdentifiedModel]:
        """Identify the arm from its logs: the result, and the model made of it.

        Raises:
            ConfigError: options contradict each other or the logs.
            LogError: a log cannot be read, or they do not belong together.
            IdentificationError: the logs do not tell everything, or the model would make the servo worse.
        """
        asked = self.options
        if asked.load_kg is not None and (asked.load_kg <= 0.0 or not asked.loaded):
            raise ConfigError(f"--load-kg {asked.load_kg:g} needs a mass above zero, and --loaded with its logs")
        measured_on = _date(asked.date)
        rows, header = self.recorded
        carried = read_rows(asked.loaded, like=header, beside=rows)[0] if asked.loaded else None
        robot, period_s = self._robot(header), header.period_ns * 1e-9
        found = identify_log(robot, rows, period_s, carried, asked.known_torque, asked.load_kg, _kinds(asked))
        runs = read_rows(asked.dynamic, like=header)[0] if asked.dynamic else None
        inertial = None if runs is None else inertia_of_log(found, runs, period_s)
        everything = np.concatenate([log for log in (rows, carried, runs) if log is not None])
        return found, model_of(found, everything, measured_on, inertial, header.plant)

    @cached_property
    def recorded(self) -> tuple[Rows, LogHeader]:
        """The rows of the logs, and the header of the first."""
        return read_rows(self.logs)

    @property
    def told_kg(self) -> float:
        """The most that the servo was told to carry while the logs were recorded, kg; 0 where they do not say."""
        masses = self.recorded[0]["payload"][:, 0]
        return float(np.nan_to_num(masses).max(initial=0.0))

    def _robot(self, header: LogHeader) -> Robot:
        name = self.options.robot or header.robot
        robot = load_robot(name)
        if robot.name != header.robot:
            raise ConfigError(f"the logs are of robot {header.robot!r}, {name} is {robot.name!r}")
        if header.joint_names != robot.joint_names:
            raise ConfigError(f"the logs have joints {', '.join(header.joint_names)}, {name} has others")
        if header.robot_digest and header.robot_digest != robot_digest(robot):
            raise ConfigError(
                f"geometry or transmission of {name} are not those that the logs were recorded with: "
                "name the robot file of that time with --robot"
            )
        return robot


def _kinds(asked: FitOptions) -> tuple[FrictionTermName, ...] | None:
    """Terms of friction to seek on every motor; None for those that show. Raises ConfigError for none and others."""
    kinds = tuple(kind for kind in asked.friction if kind != "none")
    if kinds and len(kinds) < len(asked.friction):
        raise ConfigError("--friction none stands alone: it is viscous and Coulomb friction only")
    return kinds if asked.friction else None


def _date(asked: str | None) -> str:
    """The date asked for, or today's, YYYY-MM-DD. Raises ConfigError for what is no date."""
    if asked is None:
        return datetime.fromtimestamp(time.time(), UTC).date().isoformat()
    try:
        return datetime.strptime(asked, DATE_FORMAT).replace(tzinfo=UTC).date().isoformat()
    except ValueError:
        raise ConfigError(f"--date {asked}: wanted is a day as YYYY-MM-DD, such as 2026-11-21") from None


def friction_table(robot: Robot, fitted: StribeckFit) -> Table:
    """Friction of each motor with its 95 % intervals; that of a speed is a factor."""
    table = plain_table("friction as commanded", "parameter", "value", "95 %", "unit", words=["unit"])
    for j, (name, slides) in enumerate(zip(robot.joint_names, robot.prismatic, strict=True)):
        force, speed = ("N", "m/s") if slides else ("N m", "rad/s")
        table.add_row(f"{name}.viscous", f"{fitted.viscous[j]:.4f}", "", f"{force}/({speed})")
        for k, side in enumerate(("pos", "neg")):
            table.add_row(f"{name}.coulomb_{side}", *_interval(fitted.coulomb, fitted.coulomb_half_width, j, k), force)
            table.add_row(f"{name}.excess_{side}", *_interval(fitted.excess, fitted.excess_half_width, j, k), force)
        table.add_row(f"{name}.halved_at", f"{fitted.speed[j]:.4f}", f"× {fitted.speed_factor[j]:.2f}", speed)
    return table


def _interval(values: Floats, half_widths: Floats, j: int, k: int) -> tuple[str, str]:
    return f"{values[j, k]:.4f}", f"± {half_widths[j, k]:.4f}"
