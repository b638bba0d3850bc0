"""Processes of this project run no file of the folder they are started in."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from qrobot.realtime.own_process import own_command

PACKAGE = Path(__file__).parents[3] / "qrobot"
FOR_USERS_MODULES = {"rci/hosts/__main__.py"}  # a host is started in the folder of the tasks that it offers


def test_a_users_file_called_as_a_module_of_the_library_is_not_run(tmp_path: Path) -> None:
    programs = tmp_path / "programs"
    programs.mkdir()
    for name in sys.stdlib_module_names:
        (programs / f"{name}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'a').write({name!r})\n")
    done = subprocess.run(own_command("qrobot", "--version"), cwd=programs, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert not (tmp_path / "ran").exists()


def test_every_process_is_started_so() -> None:
    others = {
        str(path.relative_to(PACKAGE))
        for path in PACKAGE.rglob("*.py")
        if '"-m", ' in path.read_text() and path.name != "own_process.py"
    }
    assert others == FOR_USERS_MODULES
