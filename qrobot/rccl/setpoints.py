"""Setpoint files: where the joints are to be, sample by sample, as text.

    # qrobot setpoints 1
    # robot puma560
    # period_us 28000
    t_s,q1,q2,q3,q4,q5,q6
    0.000000,0,-1.57079632679,3.14159265359,0,0,0
    0.028000,...

Seconds, and rad (m on a sliding joint) with twelve digits. Lines are one sample period apart.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import ConfigError, MotionError, error_text
from qrobot.fences.fence_set import FenceSet
from qrobot.motion.world.limits import MotionLimits
from qrobot.whole_file import replace_file
from qrobot.wire.vocabulary import LONGEST_PERIOD_US, SHORTEST_PERIOD_US

ENCODING: Final = "utf-8-sig"  # spreadsheets put a mark of the byte order in front
FIRST_LINE: Final = "# qrobot setpoints 1"
HEAD_LINES: Final = 4
LONGEST_NAME: Final = 100  # [A] characters
MOST_DIGITS: Final = 9  # [A] of a period
START_TOLERANCE: Final = 1e-4  # rad or m, between the arm's setpoint and the first of a list
_ROOM: Final = 1.01  # the generator itself allows this much where goals move; digits are rounded besides


@dataclass(frozen=True, eq=False)
class Setpoints:
    """A motion as a list of joint positions.

    Attributes:
        robot: name of the arm.
        period_us: from one to the next.
        q: rad or m. Shape (samples, n).
    """

    robot: str
    period_us: int
    q: Floats

    @property
    def t(self) -> Floats:
        """Times, seconds from the first. Shape (samples,)."""
        times: Floats = np.arange(len(self.q), dtype=np.float64) * (self.period_us * 1e-6)
        return times

    def check(self, limits: MotionLimits, label: str) -> None:
        """Judge the motion from rest to rest; `label` is the file, for the message.

        Raises:
            JointLimit: a joint leaves its range.
            MotionError: another number of joints, none at all, a joint too fast, or a velocity that jumps.
        """
        if not len(self.q):
            raise MotionError(f"{label}: no setpoints")
        for row, q in enumerate(self.q):
            limits.check_position(q, _at(label, row))
        at_rest = np.vstack([self.q[:1], self.q, self.q[-1:]])
        v = np.diff(at_rest, axis=0) / (self.period_us * 1e-6)
        a = np.diff(v, axis=0) / (self.period_us * 1e-6)
        _check_rates(v[:-1], limits.v_max, limits, label, "move at")
        _check_rates(a, np.maximum(limits.a_max, limits.a_stop), limits, label, "accelerate by")


def judge(
    setpoints: Setpoints, robot: str, period_s: float, limits: MotionLimits, fences: FenceSet | None, label: str
) -> None:
    """Judge setpoints for an arm wherever it stands. Raises JointLimit, FenceCrossed and MotionError."""
    _check_fit(setpoints, robot, period_s, label)
    setpoints.check(limits, label)
    check_fences(setpoints.q, fences, label)


def _check_fit(setpoints: Setpoints, robot: str, period_s: float, label: str) -> None:
    """Raise MotionError when setpoints are for another robot, or another sample period."""
    if setpoints.robot != robot:
        raise MotionError(f"{label}: made for {setpoints.robot}, this is {robot}")
    if setpoints.period_us != round(period_s * 1e6):
        periods = f"{setpoints.period_us / 1e3:g} ms from one to the next, the sample period is"
        raise MotionError(f"{label}: {periods} {period_s * 1e3:g} ms")


def check_start(q: Floats, here: Floats, limits: MotionLimits, label: str) -> None:
    """Raise MotionError when setpoints that begin at `q` (n,) do not begin where the arm is, `here` (n,)."""
    away = np.abs(q - here)
    if (away > START_TOLERANCE).any():
        j = int(away.argmax())
        far = f"{away[j]:.4g} {'m' if limits.prismatic[j] else 'rad'}"
        where = f"joint {j + 1} ({limits.names[j]}) stands {far} away"
        raise MotionError(f"{label}: does not begin where the arm is: {where}; move there first")


def check_fences(q: Floats, fences: FenceSet | None, label: str) -> None:
    """Raise FenceCrossed when one of the setpoints (k, n) is too near a fence, or the way from one to the next.

    That is straight for the joints here; servo and `SetpointPlayer` curve it, by some 1 mm where it turns hardest.
    """
    if fences is None:
        return
    last = max(1, len(q) - 1)

    def joints_at(share: float, _near: Floats) -> Floats:
        at = share * last
        before = min(int(at), len(q) - 1)
        return np.asarray(q[before] + (at - before) * (q[min(before + 1, len(q) - 1)] - q[before]))

    fences.check_path(joints_at, q[0], label, [row / last for row in range(1, last)])


def _check_rates(rates: Floats, allowed: Floats, limits: MotionLimits, label: str, what: str) -> None:
    """`rates` (samples, n) of the lines in turn."""
    too_fast = np.argwhere(np.abs(rates) > allowed * _ROOM)
    if not too_fast.size:
        return
    row, j = map(int, too_fast[0])
    joint = f"joint {j + 1} ({limits.names[j]})"
    rate = f"{rates[row, j]:.4g}, {allowed[j]:.4g} allowed"
    raise MotionError(f"{_at(label, row)}: {joint} would {what} {rate} (SI units); the file asks too much of this arm")


def _at(label: str, row: int) -> str:
    return f"{label}, line {row + HEAD_LINES + 1}"


def write_setpoints(path: Path, setpoints: Setpoints) -> None:
    """Write a setpoint file. Raises ConfigError when that fails."""
    heading = ["t_s", *(f"q{j + 1}" for j in range(setpoints.q.shape[1]))]
    head = [FIRST_LINE, f"# robot {setpoints.robot}", f"# period_us {setpoints.period_us}", ",".join(heading)]
    rows = (",".join([f"{t:.6f}", *(f"{x:.12g}" for x in q)]) for t, q in zip(setpoints.t, setpoints.q, strict=True))
    try:
        replace_file(path, "\n".join([*head, *rows]) + "\n")
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror}") from error


def read_setpoints(path: Path) -> Setpoints:
    """Read a setpoint file.

    Raises:
        ConfigError: it cannot be read, or a line is not what it should be; the message has its number.
    """
    try:
        lines = path.read_text(encoding=ENCODING).splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot read {path}: {error_text(error)}") from error
    if not lines or lines[0].strip() != FIRST_LINE:
        raise ConfigError(f"{path}, line 1: not a setpoint file; it should begin with {FIRST_LINE!r}")
    robot, period_text = _head(path, lines, 1, "robot"), _head(path, lines, 2, "period_us")
    period_us = told_period_us(period_text)
    if not SHORTEST_PERIOD_US <= period_us <= LONGEST_PERIOD_US:
        allowed = f"{SHORTEST_PERIOD_US} to {LONGEST_PERIOD_US}"
        raise ConfigError(f"{path}, line 3: the period must be a whole number from {allowed}, not {period_text[:20]!r}")
    n = _joint_count(path, lines)
    rows = list(_rows(path, lines[HEAD_LINES:], n, period_us * 1e-6))
    return Setpoints(robot, period_us, np.array(rows).reshape(-1, n))


def is_name(text: str) -> bool:
    """Whether it can stand for a robot in the head of a file: one word of characters that can be seen."""
    return text.isprintable() and len(text.split()) == 1 and len(text) <= LONGEST_NAME


def told_period_us(text: str) -> int:
    """A period that a file tells; 0 for none or one that cannot be."""
    return int(text) if text.isascii() and text.isdecimal() and len(text) <= MOST_DIGITS else 0


def _head(path: Path, lines: list[str], index: int, key: str) -> str:
    match = re.fullmatch(rf"# {key} +(\S+)\s*", lines[index] if index < len(lines) else "")
    if match is None:
        raise ConfigError(f"{path}, line {index + 1}: should say '# {key} ...'")
    return match[1]


def _joint_count(path: Path, lines: list[str]) -> int:
    names = lines[HEAD_LINES - 1].strip().split(",") if len(lines) >= HEAD_LINES else []
    n = len(names) - 1
    if n < 1 or names != ["t_s", *(f"q{j + 1}" for j in range(n))]:
        raise ConfigError(f"{path}, line {HEAD_LINES}: should name the columns, t_s,q1,q2 and so on")
    return n


def _rows(path: Path, lines: list[str], n: int, period_s: float) -> Iterator[list[float]]:
    for row, line in enumerate(lines):
        where = _at(str(path), row)
        try:
            t, *q = map(float, line.split(","))
        except ValueError:
            raise ConfigError(f"{where}: {n + 1} numbers with commas needed, not {line!r}") from None
        if len(q) != n or not np.isfinite(q).all():
            raise ConfigError(f"{where}: {n + 1} finite numbers needed, not {line!r}")
        if not abs(t - row * period_s) < 0.5 * period_s:
            raise ConfigError(f"{where}: its time should be {row * period_s:.6f}, not {t:g}; is a line missing?")
        yield q
