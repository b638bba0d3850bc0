"""Names of control laws, the shipped ones' and those of users' own as `path/to/file.py:name`.

Whoever only names a law, as a command line does, needs no law and no compiler: this file imports neither.
"""

from __future__ import annotations

from difflib import get_close_matches
from pathlib import Path
from typing import Final

from qrobot.errors import ConfigError

SHIPPED_LAWS: Final = (
    "pd",
    "qrobot",
    "qrobot+a",
    "computed-torque",
    "adaptive",
    "force",
    "joint_impedance",
    "cartesian_impedance",
    "unimation",
)  # as `servo.laws.shipped.LAWS` makes them
DEFAULT_LAW: Final = "qrobot"
LABEL_BYTES: Final = 64


def is_file_law(name: str) -> bool:
    """True when it names a file, not a shipped law."""
    return split_name(name)[0].endswith(".py")


def split_name(name: str) -> tuple[str, str]:
    """Path and name of the law, "" when there is none."""
    path, colon, law = name.rpartition(":")
    return (path, law) if colon else (law, "")


def check_law_name(name: str) -> str:
    """`name`, if it is a shipped law's or that of one in a file. Raises ConfigError naming those there are."""
    if name in SHIPPED_LAWS or is_file_law(name):
        return name
    near = get_close_matches(name, SHIPPED_LAWS, n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise ConfigError(
        f"no control law {name!r}: {hint}there are {', '.join(SHIPPED_LAWS)}, and your own as path/to/file.py:name"
    )


def law_label(name: str) -> str:
    """A name that fits into memory and logs: of a law in a file without the folder, and not too long."""
    label = Path(name).name if is_file_law(name) else name
    return label.encode()[-LABEL_BYTES:].decode(errors="ignore")


def whole_law_name(name: str) -> str:
    """A law's name with the whole path of its file, for a servo in another folder."""
    if not is_file_law(name):
        return name
    path, law = split_name(name)
    return f"{Path(path).resolve()}:{law}" if law else str(Path(path).resolve())
