"""Whether the runtime folder stays while its processes run.

systemd-logind removes `/run/user/UID` when the last session of its account ends, and what an ordinary account has in
`/dev/shm` besides (`RemoveIPC`, logind.conf(5)); not that of an account that lingers, loginctl(1).
"""

from __future__ import annotations

import os
import pwd
from pathlib import Path
from typing import Final

from qrobot.realtime.runtime_folder import MEMORY_FOLDER, SHARED_FOLDER, USERS_FOLDER
from qrobot.realtime.setup import SetupStep

ROOT: Final = Path("/")
SYSTEMD: Final = "run/systemd/system"  # it is there where systemd runs the machine, sd_booted(3)
LINGERING: Final = "var/lib/systemd/linger"  # an empty file for each account
LARGEST_SYSTEM_ACCOUNT: Final = 999  # systemd's own default; what such an account has in /dev/shm stays


def look_at_lasting(folder: Path, account: int, root: Path = ROOT) -> SetupStep:
    """Whether the runtime `folder` of an account outlives its log-out; `root` of the file system that is looked at."""
    name, found = "it stays", _account_name(account)
    goes = folder.is_relative_to(USERS_FOLDER) or (
        folder.is_relative_to(MEMORY_FOLDER) and account > LARGEST_SYSTEM_ACCOUNT
    )
    if not goes or not (root / SYSTEMD).is_dir() or (root / LINGERING / found).exists():
        return SetupStep(name, True, "also when its account logs out" if goes else "whoever logs out")
    detail = f"{folder} is removed when {found} logs out, under arms that run: no command finds them any more"
    return SetupStep(name, False, detail, f"loginctl enable-linger {found}, or have {SHARED_FOLDER} made")


def lasting_advice(folder: Path, root: Path = ROOT) -> str:
    """A sentence for who starts an arm in a folder of this account that may go; "" for one that stays."""
    step = look_at_lasting(folder, os.geteuid(), root)
    return "" if step.ok else f"{step.detail} ({step.remedy})"


def _account_name(account: int) -> str:
    try:
        return pwd.getpwuid(account).pw_name
    except KeyError:
        return str(account)
