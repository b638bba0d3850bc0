"""Settings in the head of a program in Python, in the form that PEP 723 gives scripts:

# /// script
# [tool.qrobot]
# scene = "crank"
# ///
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any, Final

from qrobot.config.document import Table, check_document
from qrobot.config.scene import SceneKind
from qrobot.errors import ConfigError

BLOCK: Final = re.compile(r"(?m)^# /// script$\s(?P<lines>(^#(| .*)$\s)+)^# ///$")  # as in PEP 723


class ProgramSettings(Table):
    """Requirements of a program besides an arm.

    Attributes:
        scene: what has to stand around an emulated arm; a real one has what it has.
    """

    scene: SceneKind | None = None


def settings_of(program: Path) -> ProgramSettings:
    """The settings in the head of a program; none where it has no such head, or is no text.

    Raises:
        ConfigError: the head cannot be read, or names something else.
    """
    try:
        found = BLOCK.search(program.read_text(encoding="utf-8-sig"))
    except UnicodeDecodeError:
        return ProgramSettings()
    return ProgramSettings() if found is None else _read(found["lines"], program)


def _read(lines: str, program: Path) -> ProgramSettings:
    try:
        head: dict[str, Any] = tomllib.loads("\n".join(line.removeprefix("#") for line in lines.splitlines()))
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{program}, in its head: {error}") from error
    tools = head.get("tool", {})
    ours = tools.get("qrobot", {}) if isinstance(tools, dict) else tools
    if not isinstance(ours, dict):
        raise ConfigError(f"{program}, in its head: [tool.qrobot] is a table, not {ours!r:.40}")
    return check_document(ProgramSettings, ours, f"{program.name}, [tool.qrobot]")
