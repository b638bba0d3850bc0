"""Calibration tables: which potentiometer reading belongs to which index pulse of each joint.

Plain text, for each joint a header and then a row `pot encoder` for each index pulse met when the joint moves in its
positive direction:

    pot      16-bit ADC units of 20 V / 65536
    encoder  calibrated counts, READY is 0, without the offset that joint 4 carries on the board

The header is `joint n` in our tables and `n rows`, the joint and how many rows follow, in those of the board vendor
(TRC004 vendor driver v4.3). Both are read. Lines that begin with `#` are ours alone: the vendor's driver ends at them.
The first one may carry a checksum of the rows, `# crc32 89abcdef`, by which a damaged file is told from a whole one.
"""

from __future__ import annotations

import re
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

import numpy as np

from qrobot.arrays import Ints
from qrobot.config import Robot
from qrobot.config.document import packaged_path
from qrobot.config.kinds import FileKind
from qrobot.errors import ConfigError
from qrobot.whole_file import replace_file

MOST_ROWS: Final = 256  # per joint; the PUMA 560 has up to 80
FEWEST_ROWS: Final = 8
_IS_COUNT: Final = re.compile("[0-9]{1,6}")  # of rows
FARTHEST_POT: Final = 32768  # 10 V
FARTHEST_COUNT: Final = 65536  # a 16-bit counter, shifted by an offset as on joint 4
OFF_LINE: Final = 0.5  # rows of pot travel by which a reading may lie beside the straight line through all
OFF_ROBOT: Final = 1.0  # rows by which that line may lie beside the robot file's; 0.2 in the vendor's sample [V]
EMULATED: Final = "calibration table of the emulated"  # a comment with it: measured on no real arm
_CRC: Final = re.compile(r"#\s*crc32\s+([0-9a-f]{8})\s*$")
_REMEDY: Final = "measure it anew, or for an emulated arm `qrobot calibrate --make-table FILE`"

TableFormat = Literal["qrobot", "vendor"]


@dataclass(frozen=True)
class CalibrationTable:
    """Rows of every joint, in the order of motion in the positive direction of the joint.

    Attributes:
        pots: readings by joint, ADC units. Shapes (rows,).
        counts: encoder counts at those index pulses. Shapes (rows,).
        emulated: it says of itself that it is an emulated arm's.
    """

    pots: tuple[Ints, ...]
    counts: tuple[Ints, ...]
    emulated: bool = False

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.pots)

    def check_against(self, robot: Robot, label: str) -> None:
        """Raise ConfigError when this is no table of `robot`.

        Joints, counts per turn, index phases or the lines of the potentiometers differ.
        """
        if self.n != robot.n:
            raise ConfigError(f"{label}: {self.n} joints, {robot.name} has {robot.n}")
        transmission = robot.transmission
        for joint, counts in enumerate(self.counts):
            step, per_turn = int(counts[1] - counts[0]), int(transmission.counts_per_rev[joint])
            direction = int(np.sign(transmission.rad_per_count[joint]))
            if step != direction * per_turn:
                what = f"rows are {step} counts apart, {robot.name} has {direction * per_turn:+d} a turn"
                raise ConfigError(f"{label}: joint {joint + 1}: {what}; the robot file or the table is another arm's")
            phase = int(transmission.index_phase[joint]) % per_turn
            if int(counts[0]) % per_turn != phase:
                what = f"index at {int(counts[0]) % per_turn} of a turn, {robot.name} has it at {phase}"
                raise ConfigError(f"{label}: joint {joint + 1}: {what}; the robot file or the table is another arm's")
            self._check_line(robot, joint, f"{label}: joint {joint + 1}")

    def _check_line(self, robot: Robot, joint: int, where: str) -> None:
        """Raise ConfigError when the robot file's straight line is not that of the readings, from end to end.

        The pose before calibration is taken from it, and the readings of a calibration are corrected by its slope.
        """
        per_turn = int(robot.transmission.counts_per_rev[joint])
        zero, slope = float(robot.transmission.pot_at_zero[joint]), float(robot.transmission.pots_per_rev[joint])
        turns = self.counts[joint][1:] / per_turn  # the first row may be off
        found_slope, found_zero = np.polyfit(turns, self.pots[joint][1:], 1)
        beside = np.abs(found_zero - zero + (found_slope - slope) * turns).max()
        if beside > OFF_ROBOT * abs(found_slope):
            raise ConfigError(
                f"{where}: its readings are {found_zero:.0f} at count 0 and {found_slope:+.1f} a motor turn, "
                f"{robot.name} has pot_at_zero {zero:.0f} and pot_per_rev {slope:+.1f}: the table or the robot file is "
                "another arm's, or the ends of the potentiometer or A and B of the encoder are swapped, or count_sign "
                "was changed alone"
            )


class CalibrationParams(NamedTuple):
    """A table as the cycle takes it; without one `rows` is 0 everywhere."""

    rows: Any  # int64[n]
    pot: Any  # float64[n, MOST_ROWS]
    count: Any  # int64[n, MOST_ROWS]


def calibration_params(n: int, table: CalibrationTable | None) -> CalibrationParams:
    """Arrays of one size for every table, so that the cycle is compiled once."""
    params = CalibrationParams(
        np.zeros(n, np.int64), np.zeros((n, MOST_ROWS)), np.zeros((n, MOST_ROWS), dtype=np.int64)
    )
    if table is not None:
        for joint, (pots, counts) in enumerate(zip(table.pots, table.counts, strict=True)):
            params.rows[joint] = pots.size
            params.pot[joint, : pots.size], params.count[joint, : pots.size] = pots, counts
    return params


def table_path(name_or_path: str | Path) -> Path:
    """Path of a table: a packaged one by name, or the path given if it ends in `.txt`. Raises ConfigError."""
    return packaged_path(name_or_path, FileKind.CALIBRATION, "calibration", ".txt")


def load_table(name_or_path: str | Path, robot: Robot) -> CalibrationTable:
    """Read and check the table of `robot`.

    Raises:
        ConfigError: there is no such file, or it is damaged, or another arm's; says where and what to do.
    """
    path = table_path(name_or_path)
    try:
        text = path.read_text(encoding="ascii")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: {error}; {_REMEDY}") from error
    table = parse_table(text, path.name)
    table.check_against(robot, path.name)
    return table


def parse_table(text: str, label: str) -> CalibrationTable:
    """Make a table of its text; `label` stands before what is wrong.

    Raises:
        ConfigError: damaged, truncated, or readings that no potentiometer gives; names line or joint.
    """
    lines = text.splitlines()
    _check_crc(lines, label)
    numbered = [(number, line.split()) for number, line in enumerate(lines, 1) if _has_words(line)]
    headed = any(words[0].lower() == "joint" for _, words in numbered)
    rows = _rows_below_headers(numbered, label) if headed else _rows_by_number(numbered, label)
    if not rows:
        raise ConfigError(f"{label}: no joints in it; {_REMEDY}")
    for joint, joint_rows in enumerate(rows, 1):
        _check_rows(np.array(joint_rows, dtype=np.int64).reshape(-1, 2), f"{label}: joint {joint}")
    arrays = [np.array(joint_rows, dtype=np.int64) for joint_rows in rows]
    return CalibrationTable(tuple(a[:, 0] for a in arrays), tuple(a[:, 1] for a in arrays), is_emulated(text))


def is_emulated(text: str) -> bool:
    """Whether the text of a table says that it is an emulated arm's."""
    return any(line.startswith("#") and EMULATED in line for line in text.splitlines())


def _has_words(line: str) -> bool:
    return bool(line.split()) and not line.startswith("#")


def _rows_below_headers(lines: list[tuple[int, list[str]]], label: str) -> list[list[tuple[int, int]]]:
    """Rows of each joint where the headers are `joint n`."""
    rows: list[list[tuple[int, int]]] = []
    for number, words in lines:
        if words[0].lower() == "joint":
            if words[1:] != [str(len(rows) + 1)]:
                raise ConfigError(f"{label}:{number}: expected `joint {len(rows) + 1}`, found {' '.join(words)!r}")
            rows.append([])
        elif not rows:
            raise ConfigError(f"{label}:{number}: a row before the first `joint 1`")
        else:
            rows[-1].append(_row(words, f"{label}:{number}"))
    return rows


def _rows_by_number(lines: list[tuple[int, list[str]]], label: str) -> list[list[tuple[int, int]]]:
    """Rows of each joint where the headers are the vendor's, `n rows`."""
    rows: list[list[tuple[int, int]]] = []
    missing = 0
    for number, words in lines:
        if missing:
            rows[-1].append(_row(words, f"{label}:{number}"))
            missing -= 1
            continue
        joint = len(rows) + 1
        if len(words) != 2 or words[0] != str(joint) or not _IS_COUNT.fullmatch(words[1]):
            raise ConfigError(
                f"{label}:{number}: expected the header of joint {joint}, `{joint} ROWS` or `joint {joint}`, "
                f"found {' '.join(words)!r}"
            )
        rows.append([])
        missing = int(words[1])
    if missing:
        raise ConfigError(f"{label}: joint {len(rows)}: {missing} rows are missing at the end; {_REMEDY}")
    return rows


def _row(words: list[str], where: str) -> tuple[int, int]:
    try:
        pot, count = (int(word) for word in words)
    except ValueError as error:
        raise ConfigError(f"{where}: expected two whole numbers, `pot encoder`, found {' '.join(words)!r}") from error
    if not (abs(pot) <= FARTHEST_POT and abs(count) <= FARTHEST_COUNT):
        raise ConfigError(f"{where}: {pot} {count} is more than converter and counter can show")
    return pot, count


def _check_rows(rows: Ints, where: str) -> None:
    """Index pulses are one turn apart, and the readings lie along a line that rises or falls throughout.

    Of the first row only the count is held to that: the vendor's tables begin with a reading 20 to 100 units off, from
    backlash at the start of the motion.
    """
    if not FEWEST_ROWS <= len(rows) <= MOST_ROWS:
        raise ConfigError(f"{where}: {len(rows)} rows, {FEWEST_ROWS} to {MOST_ROWS} are needed; {_REMEDY}")
    steps = np.diff(rows[:, 1])
    if not steps[0] or (steps != steps[0]).any():
        at = int(np.argmax(steps != np.median(steps))) + 2
        raise ConfigError(f"{where}: row {at} is not one motor turn after the row before; {_REMEDY}")
    turns, pots = np.arange(1, len(rows)), rows[1:, 0]
    slope, start = np.polyfit(turns, pots, 1)
    beside = np.abs(pots - (start + slope * turns))
    if (np.diff(pots) * slope <= 0).any() or beside.max() > OFF_LINE * abs(slope):
        worst = int(np.argmax(beside)) + 2
        raise ConfigError(f"{where}: the pot reading of row {worst} is off the line through the others; {_REMEDY}")


def _check_crc(lines: list[str], label: str) -> None:
    found = _CRC.match(lines[0]) if lines else None
    if found is not None and found[1] != rows_crc(lines):
        raise ConfigError(f"{label}: damaged, its checksum is not that of its rows; restore a copy, or {_REMEDY}")


def rows_crc(lines: list[str]) -> str:
    """CRC-32 of all lines that are no comments, however they are spaced and ended."""
    rows = [" ".join(line.split()) for line in lines if line.split() and not line.startswith("#")]
    return f"{zlib.crc32(chr(10).join(rows).encode()):08x}"


def format_table(table: CalibrationTable, about: str, form: TableFormat = "qrobot") -> str:
    """The text of a table; `about` is one line of comment, for which the vendor's format has no place."""
    rows: list[str] = []
    for joint, (pots, counts) in enumerate(zip(table.pots, table.counts, strict=True), 1):
        rows.append(f"joint {joint}" if form == "qrobot" else f"{joint} {pots.size}")
        rows += [f"{pot} {count}" for pot, count in zip(pots.tolist(), counts.tolist(), strict=True)]
    if form == "vendor":
        return "".join(f"{row}\r\n" for row in rows)
    return "\n".join([f"# crc32 {rows_crc(rows)}", f"# {about}", *rows, ""])


def write_table(path: Path, table: CalibrationTable, about: str, form: TableFormat = "qrobot") -> None:
    """Write a table so that the file is the old one or the new one, whatever dies meanwhile. Raises ConfigError."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, format_table(table, about, form), "ascii")
    except OSError as error:
        raise ConfigError(f"the table cannot be written to {path}: {error.strerror}") from error
