"""Names inside and around log files."""

from __future__ import annotations

from glob import escape
from pathlib import Path
from typing import Final

TICK_TOPIC: Final = "/servo/tick"
STATUS_TOPIC: Final = "/servo/log_status"
LAW_TOPIC: Final = "/servo/law"
JOINTS_TOPIC: Final = "/arm/joint_states"
FRAMES_TOPIC: Final = "/tf"
TOOL_TOPIC: Final = "/arm/tool_pose"
SCENE_TOPIC: Final = "/arm/scene"
STAMP: Final = "%Y%m%dT%H%M%SZ"  # in names: the time at which a log begins, UTC


def part_path(path: Path, part: int) -> Path:
    """File of part `part`, from 1, of the log `path`: run.mcap, run.0002.mcap, run.0003.mcap."""
    return path if part == 1 else path.with_name(f"{path.stem}.{part:04d}{path.suffix}")


def later_parts(path: Path) -> list[Path]:
    """Files named as parts from 2 on of the log `path`, in order; the first ones may have been removed."""
    found = path.parent.glob(f"{escape(path.stem)}.{'[0-9]' * 4}*{escape(path.suffix)}")
    numbers = {part: part.name.removeprefix(f"{path.stem}.").removesuffix(path.suffix) for part in found}
    named = {int(number): part for part, number in numbers.items() if number.isdecimal() and number.isascii()}
    return [named[number] for number in sorted(named) if number > 1 and named[number] == part_path(path, number)]


def part_beside(path: Path, own: int, part: int) -> Path:
    """File of part `part` of the log whose part `own` is in `path`; where that was renamed, of one of its new name."""
    number = f".{own:04d}"
    first = path.with_name(path.stem.removesuffix(number) + path.suffix) if own > 1 else path
    return part_path(first, part)
