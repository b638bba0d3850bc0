"""Facts at the head of a log: arm, servo, clock, and kind of machine."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from itertools import chain, count
from pathlib import Path
from typing import Final

from pydantic import TypeAdapter, ValidationError

from qrobot.config import Robot
from qrobot.config.identified import robot_digest
from qrobot.errors import LogError
from qrobot.realtime.setup import SetupStep
from qrobot.servo.memory.telemetry import TelemetryLayout

METADATA_NAME: Final = "qrobot"
FORMAT: Final = "1"
REALTIME: Final = "realtime"
LOCKSTEP: Final = "lockstep"


@dataclass(frozen=True)
class Attachment:
    """A file carried inside the log, such as the robot's TOML."""

    name: str
    data: bytes
    media_type: str = "application/toml"


@dataclass(frozen=True)
class LogHeader:
    """Constant facts of one log, equal in all its parts but for `part`.

    Attributes:
        robot: name of the robot.
        arm: name of the arm in its deployment file; empty when unknown.
        robot_digest: of its joints, geometry and transmission (`config.identified.robot_digest`); empty when unknown.
        joint_names: one per joint; their number is the joint count.
        period_ns: length of a servo cycle, ns.
        prismatic: per joint, True when it slides (m, N) instead of turning (rad, N m); empty means none does.
        law: name of the control law at the first row.
        velocity: how velocities were estimated; empty when unknown.
        interpolation: form of the path between setpoints; empty when unknown.
        clock: REALTIME or LOCKSTEP.
        plant: what stood behind the board, e.g. "nominal" or "mismatched"; empty for a real arm, or when unknown.
        wall_offset_ns: add it to a row's t_ns for the time since 1970, ns; 0 when time is virtual.
        part: number of this part of a rotated log, from 1.
        version: of the program that wrote it.
        setup: the real-time measures in force when recording began, and those refused.
    """

    robot: str
    joint_names: tuple[str, ...]
    period_ns: int
    prismatic: tuple[bool, ...] = ()
    law: str = ""
    velocity: str = ""
    interpolation: str = ""
    clock: str = REALTIME
    plant: str = ""
    wall_offset_ns: int = 0
    part: int = 1
    version: str = ""
    robot_digest: str = ""
    setup: tuple[SetupStep, ...] = ()
    arm: str = ""

    def __post_init__(self) -> None:
        if not self.joint_names or self.period_ns <= 0:
            raise LogError(f"a log needs joints and a positive period, not {self.joint_names} and {self.period_ns} ns")
        if self.prismatic and len(self.prismatic) != self.n:
            raise LogError(f"{self.n} joints, but {len(self.prismatic)} entries say which are prismatic")

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @property
    def rate_hz(self) -> float:
        """Servo rate in hertz."""
        return 1e9 / self.period_ns

    @property
    def layout(self) -> TelemetryLayout:
        """Layout of the rows."""
        return TelemetryLayout(self.n)

    def is_prismatic(self, joint: int) -> bool:
        """True when joint `joint`, from 0, slides."""
        return bool(self.prismatic) and self.prismatic[joint]

    def to_metadata(self) -> dict[str, str]:
        """The header as MCAP metadata: JSON values under the names above, and `format`."""
        return {"format": FORMAT} | {key: json.dumps(value) for key, value in asdict(self).items()}

    @classmethod
    def from_metadata(cls, metadata: Mapping[str, str]) -> LogHeader:
        """Inverse of `to_metadata`; what an older log does not tell is unknown.

        Raises LogError when the log is of another format.
        """
        if metadata.get("format") != FORMAT:
            raise LogError(f"the log has format {metadata.get('format')!r}, this version reads {FORMAT!r}")
        try:
            values = {field.name: json.loads(metadata[field.name]) for field in fields(cls) if field.name in metadata}
            header: LogHeader = _checked().validate_python(values)
        except ValidationError as error:
            places = (f"{'.'.join(map(str, wrong['loc']))}: {wrong['msg']}" for wrong in error.errors())
            raise LogError(f"the log's header is damaged: {'; '.join(places)}") from None
        except (ValueError, RecursionError) as error:
            raise LogError(f"the log's header is damaged: {error}") from None
        return header


def header_for(
    robot: Robot,
    period_ns: int,
    law: str,
    clock: str = REALTIME,
    plant: str = "",
    velocity: str = "",
    interpolation: str = "",
    arm: str = "",
) -> LogHeader:
    """Header of a log of `robot`; a caller in real time adds the wall clock and the set-up."""
    return LogHeader(
        robot=robot.name,
        joint_names=robot.joint_names,
        period_ns=period_ns,
        prismatic=tuple(bool(kind) for kind in robot.prismatic),
        law=law,
        velocity=velocity,
        interpolation=interpolation,
        clock=clock,
        plant=plant,
        version=_version(),
        robot_digest=robot_digest(robot),
        arm=arm,
    )


def _version() -> str:
    try:
        return version("qrobot")
    except PackageNotFoundError:
        return ""


def attach_files(paths: Iterable[Path]) -> list[Attachment]:
    """The configuration files to carry in a log; a name that another one has too gets a number, as "arm-2.toml".

    Raises LogError when one cannot be read.
    """
    found: dict[str, bytes] = {}
    try:
        for path in paths:
            names = chain([path.name], (f"{path.stem}-{number}{path.suffix}" for number in count(2)))
            found[next(name for name in names if name not in found)] = path.read_bytes()
        return [Attachment(name, content) for name, content in found.items()]
    except OSError as error:
        raise LogError(f"cannot attach {error.filename}: {error.strerror}") from None


@cache
def _checked() -> TypeAdapter[LogHeader]:
    return TypeAdapter(LogHeader)
