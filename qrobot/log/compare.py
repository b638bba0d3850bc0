"""Two logs of one robot side by side: which tracked better, which was more punctual, and what was different about them.

Time counts from the first tracking cycle of each log. Two runs of one program then show the same motion, but for what
delays the reference differently (the form of interpolation, the sample period, how a stream began): that remaining
shift is found by laying the desired positions over each other.
"""

from __future__ import annotations

import hashlib
import math
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from typing import Any, Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config.kinds import FileKind, kind_of_content
from qrobot.errors import LogError
from qrobot.log.events import GAINS
from qrobot.log.header import LogHeader
from qrobot.log.read import Log
from qrobot.log.summary import TrackingSummary, plain_numbers, tracking_summary
from qrobot.modecodes import Mode

MAX_SHIFT_S: Final = 0.25  # two and a half frames of the longest sample period
SHIFT_STEPS_S: Final = (0.005, 0.0005, 0.00005)  # each search refines the one before
COMPARED_STEP_S: Final = 0.004
NOT_A_CHOICE: Final = ("robot", "law", "joint_names", "prismatic", "wall_offset_ns", "part", "setup")


@dataclass(frozen=True)
class JointComparison:
    """Tracking errors of one joint in both logs, rad or m; ratios are b over a, NaN when that says nothing."""

    name: str
    max_error: tuple[float, float]
    rms_error: tuple[float, float]
    setpoints_differ: float  # largest difference of the desired positions, laid over each other

    @property
    def max_ratio(self) -> float:
        """Largest error of b over that of a."""
        return _ratio(*self.max_error)

    @property
    def rms_ratio(self) -> float:
        """Rms error of b over that of a."""
        return _ratio(*self.rms_error)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        ratios = {"max_ratio": self.max_ratio, "rms_ratio": self.rms_ratio}
        numbers: dict[str, Any] = plain_numbers(asdict(self) | ratios)
        return numbers


@dataclass(frozen=True)
class Difference:
    """One choice that the logs' headers or attached files record differently; None where one says nothing."""

    what: str
    a: Any
    b: Any


@dataclass(frozen=True)
class LogComparison:
    """Two logs of one robot; made by `compare_logs`.

    Attributes:
        shift_s: by how much b's desired motion comes later after its first tracking cycle than a's.
        summaries: numbers of a and b.
        differences: what the logs say was different.
    """

    a: Log
    b: Log
    shift_s: float
    summaries: tuple[TrackingSummary, TrackingSummary]
    differences: tuple[Difference, ...]

    @cached_property
    def joints(self) -> tuple[JointComparison, ...]:
        """One entry per joint."""
        a, b = self.summaries
        setpoints_differ = np.abs(_overlap(self.a, self.b, self.shift_s)).max(axis=0)
        return tuple(
            JointComparison(
                name,
                (a.max_abs_error[j], b.max_abs_error[j]),
                (a.rms_error[j], b.rms_error[j]),
                float(setpoints_differ[j]),
            )
            for j, name in enumerate(self.a.header.joint_names)
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        a, b = ({"file": str(log.path)} | s.to_dict() for log, s in zip((self.a, self.b), self.summaries, strict=True))
        return {
            "a": a,
            "b": b,
            "shift_s": self.shift_s,
            "joints": [joint.to_dict() for joint in self.joints],
            "differences": [asdict(difference) for difference in self.differences],
        }


def compare_logs(a: Log, b: Log) -> LogComparison:
    """Lay two logs side by side.

    Raises:
        LogError: they are of different robots, or one of them never tracked.
    """
    _require_same_robot(a, b)
    for log in (a, b):
        _first_tracking(log)
    differences = (*_law_differences(a, b), *_header_differences(a.header, b.header), *_file_differences(a, b))
    return LogComparison(a, b, _find_shift(a, b), (tracking_summary(a), tracking_summary(b)), differences)


def tracking_time(log: Log) -> Floats:
    """Seconds since the first tracking cycle, shape (rows,). Raises LogError when there is none."""
    t_ns = log.rows["t_ns"]
    return np.asarray((t_ns - t_ns[_first_tracking(log)]) * 1e-9, dtype=np.float64)


def _require_same_robot(a: Log, b: Log) -> None:
    told = [f"{log.path} is of {log.header.robot} ({', '.join(log.header.joint_names)})" for log in (a, b)]
    if (a.header.robot, a.header.joint_names) != (b.header.robot, b.header.joint_names):
        raise LogError(f"only logs of one robot can be compared: {told[0]}, {told[1]}")


def _first_tracking(log: Log) -> int:
    tracking = log.rows["mode"] == Mode.TRACKING
    if not tracking.any():
        raise LogError(f"{log.path} has no cycle in which the arm tracked setpoints: there is no motion to compare")
    return int(np.argmax(tracking))


# ------------------------------------------------------------------------------------------------------------- shift


def _find_shift(a: Log, b: Log) -> float:
    """The shift within `MAX_SHIFT_S` under which the desired positions agree best."""
    shift, reach = 0.0, MAX_SHIFT_S
    for step in SHIFT_STEPS_S:
        candidates = shift + np.arange(-round(reach / step), round(reach / step) + 1) * step
        misses = [_miss(_overlap(a, b, candidate)) for candidate in candidates]
        best = np.flatnonzero(np.array(misses) <= min(misses) * (1.0 + 1e-9))
        shift = float(candidates[best[np.argmin(np.abs(candidates[best]))]])  # of equals the smallest shift
        reach = step
    return shift


def _miss(difference: Floats) -> float:
    """Mean square of what is left; infinite where logs shorter than the shift have nothing in common."""
    return float(np.mean(difference**2)) if difference.size else math.inf


def _overlap(a: Log, b: Log, shift_s: float) -> Floats:
    """Desired positions of b less those of a where both tracked, one row per `COMPARED_STEP_S`. Shape (rows, n)."""
    (time_a, path_a), (time_b, path_b) = _path(a), _path(b)
    end = max(COMPARED_STEP_S, min(time_a[-1], time_b[-1] - shift_s))
    times = np.arange(max(0.0, -shift_s), end, COMPARED_STEP_S)
    difference = [
        np.interp(times + shift_s, time_b, path_b[:, j]) - np.interp(times, time_a, path_a[:, j])
        for j in range(a.header.n)
    ]
    return np.array(difference).T


def _path(log: Log) -> tuple[Floats, Floats]:
    tracking = log.rows["mode"] == Mode.TRACKING
    return tracking_time(log)[tracking], log.rows["q_ref"][tracking]


# ------------------------------------------------------------------------------------------------------- differences


def _law_differences(a: Log, b: Log) -> Iterator[Difference]:
    """Law and gains: those of the first tracking cycle, and all laws of a log in which they changed."""
    if a.law_names != b.law_names:
        yield Difference("law", *(", then ".join(log.law_names) for log in (a, b)))
    one, other = (log.maybe_law_at(int(log.rows["tick"][_first_tracking(log)])) for log in (a, b))
    for told, name in (("law settings", "settings"), *GAINS) if one and other else ():
        if getattr(one, name) != getattr(other, name):
            yield Difference(told, getattr(one, name), getattr(other, name))


def _header_differences(a: LogHeader, b: LogHeader) -> Iterator[Difference]:
    for field in fields(LogHeader):
        one, other = getattr(a, field.name), getattr(b, field.name)
        if field.name not in NOT_A_CHOICE and one != other:
            yield Difference(field.name, one, other)
    steps_a, steps_b = ({step.name: step.ok for step in header.setup} for header in (a, b))
    for name in sorted(steps_a.keys() | steps_b.keys()) if steps_a and steps_b else ():  # lock-step sets nothing up
        if steps_a.get(name) != steps_b.get(name):
            yield Difference(f"set-up: {name}", steps_a.get(name), steps_b.get(name))


def _file_differences(a: Log, b: Log) -> Iterator[Difference]:
    """Key by key what the files carried in both logs say differently: gains, limits, time-outs; and a model in one."""
    for label, *contents in _pairs(a.attachments, b.attachments):
        one, other = map(_flat, contents)
        for key in sorted(one.keys() | other.keys()):
            if one.get(key) != other.get(key):
                yield Difference(f"{label}: {key}", one.get(key), other.get(key))
    models = [_of_kind(log.attachments).get(FileKind.MODEL) for log in (a, b)]
    if (models[0] is None) != (models[1] is None):
        yield Difference("model", *models)


def _pairs(a: Mapping[str, bytes], b: Mapping[str, bytes]) -> Iterator[tuple[str, bytes, bytes]]:
    """Files of one name, then those of one kind that have other names: a label, and what they hold."""
    same = a.keys() & b.keys()
    yield from ((name, a[name], b[name]) for name in sorted(same))
    one, other = (_of_kind({name: data for name, data in files.items() if name not in same}) for files in (a, b))
    for kind in sorted(one.keys() & other.keys(), key=lambda kind: kind.name):
        yield f"{one[kind]} and {other[kind]}", a[one[kind]], b[other[kind]]


def _of_kind(files: Mapping[str, bytes]) -> dict[FileKind, str]:
    """Name of the file of each kind, where there is one of it."""
    kinds = {name: kind_of_content(data) for name, data in files.items()}
    counted = Counter(kinds.values())
    return {kind: name for name, kind in kinds.items() if kind is not None and counted[kind] == 1}


def _flat(data: bytes) -> dict[str, Any]:
    """Values of a TOML file by dotted key; what is no TOML, as a law in Python, counts as one value: its digest."""
    try:
        return dict(_leaves(tomllib.loads(data.decode("utf-8-sig")), ""))
    except ValueError:
        return {"contents": f"sha256 {hashlib.sha256(data).hexdigest()[:12]}"}


def _leaves(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        inner = ((f"{path}.{key}".lstrip("."), item) for key, item in value.items())
    elif isinstance(value, list) and value and isinstance(value[0], Mapping):
        inner = ((f"{path}[{number}]", item) for number, item in enumerate(value, 1))
    else:
        yield path, value
        return
    for key, item in inner:
        yield from _leaves(item, key)


def _ratio(a: float, b: float) -> float:
    return b / a if a > 0.0 else float("nan")
