"""Interface of a study: what a campaign does to each of its arms."""

from __future__ import annotations

import hashlib
import inspect
import json
import socket
from abc import ABC, abstractmethod
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np

from qrobot.config import Robot, load_robot
from qrobot.errors import ConfigError, QRobotError
from qrobot.realtime.source_digest import source_stamp

DIGITS: Final = 6  # significant, of what is kept: sums in another order differ in the sixteenth

ArmResult = dict[str, Any]
"""Of one arm: its `seed`, and the numbers of its study or, where it ended in an error, `failed`."""


@dataclass(frozen=True)
class Study(ABC):
    """Terms of a campaign; all of it goes to the workers.

    Attributes:
        robot_file: robot whose kind the arms are, a packaged one's name or a path that every host has.
        rate_hz: of the servo.

    Raises:
        ConfigError: something of it does not exist or is out of range.
    """

    kind: ClassVar[str]
    robot_file: str = "puma560"
    rate_hz: float = 1000.0

    def __post_init__(self) -> None:
        _loaded(self.robot_file)

    @abstractmethod
    def judge(self, seed: int) -> ArmResult:
        """Outcome of the arm drawn with `seed`. Raises QRobotError when there is none."""

    @property
    def robot(self) -> Robot:
        """The robot of the study's file. Raises ConfigError."""
        return _loaded(self.robot_file)

    @property
    def terms(self) -> ArmResult:
        """Parameters on which outcomes depend beside the seed: only those of equal terms belong together."""
        robot = json.dumps(self.robot.model_dump(), default=np.ndarray.tolist, sort_keys=True)
        return {
            "study": self.kind,
            **json.loads(json.dumps(asdict(self))),
            "joints": list(self.robot.joint_names),
            "robot": hashlib.sha256(robot.encode()).hexdigest()[:16],
            "code": source_stamp(Path(inspect.getfile(type(self))))[:16],
        }


@cache
def _loaded(robot_file: str) -> Robot:
    return load_robot(robot_file)


def attempt(study: Study, terms: ArmResult, seed: int) -> ArmResult:
    """Do to one arm what the study says: what a worker is asked for.

    Raises:
        ConfigError: on this host the same words mean something else, by another robot file or another program.
    """
    if differing := sorted(key for key, value in study.terms.items() if terms[key] != value):
        raise ConfigError(f"host {socket.gethostname()} has another {' and '.join(differing)} than this one")
    try:
        return {"seed": seed, **study.judge(seed)}
    except QRobotError as error:
        return {"seed": seed, "failed": f"{type(error).__name__}: {error}"}


def kept(values: Any) -> Any:
    """An array or a number as it is kept: plain, with `DIGITS` digits."""
    if np.ndim(values):
        return [kept(value) for value in values]
    return float(f"{float(values):.{DIGITS}g}")
