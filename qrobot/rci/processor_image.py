"""Image of a program for a processor in a process of its own, handed over at its start."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from qrobot.arrays import Floats
from qrobot.rci.descriptor import TaskDescriptor
from qrobot.rci.environment import Environment
from qrobot.rci.mapped_area import MappedArea
from qrobot.rci.robot_data import KnownRobot, RobotData
from qrobot.rci.task_table import SharedArea

SharedVariable = tuple[str, str, str, tuple[int, ...]]
"""Module, name, type and shape of a global array in shared memory."""


class KnownTask(NamedTuple):
    """A task of the program, and the entry of its robot."""

    td: TaskDescriptor
    robot: KnownRobot | None


class KnownArea(NamedTuple):
    """A region of shared memory, and the variable that lies there."""

    area: SharedArea
    variable: SharedVariable | None


class TaskNumbers:
    """Numbers of compiled tasks: the region of shared memory that has the name of the task."""

    def __init__(self) -> None:
        self._regions: dict[str, Floats] = {}

    def know(self, areas: list[KnownArea]) -> None:
        """All regions are known."""
        for area, _ in areas:
            self._regions[area.label] = area.memory[: area.memory.size // 8 * 8].view(np.float64)

    def of(self, td: TaskDescriptor) -> Floats:
        """The numbers of a task; none without a region of its name."""
        return self._regions.get(td.name, np.empty(0))


@dataclass(frozen=True)
class TaskRecord:
    """Ingredients of a descriptor: `TaskDescriptor`, with its words, and the entry and the data of its robot.

    Fences are in the data: the program alone knows which are in force.
    """

    name: str
    bit: int
    processor: str
    priority: int
    area: MappedArea
    robot: KnownRobot | None
    data: RobotData | None


@dataclass(frozen=True)
class AreaRecord:
    """Ingredients of a region of shared memory; `variable`: module and name of shared data, with type and shape."""

    label: str
    size: int
    access: int
    area: MappedArea
    variable: SharedVariable | None = None


@dataclass(frozen=True)
class ProcessorImage:
    """All that a processor has to know of its program."""

    name: str
    cpu: int | None
    rate_hz: int
    epoch_ns: int
    parent_pid: int
    tasks: list[TaskRecord]
    areas: list[AreaRecord]
    environment: Environment
