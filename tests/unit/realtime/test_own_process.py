"""Processes of this project run no file of the folder they are started in."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from qrobot.realtime.own_process import own_command
from qrobot.servo.laws.trial_process import _CHECKER

PACKAGE = Path(__file__).parents[3] / "qrobot"
OTHERS = {
    "rci/hosts/__main__.py",  # a host is started in the folder of the tasks that it offers
    "servo/laws/trial_process.py",  # -P -c
    "pendant/command_run.py",  # -I -S
    "cli/toolchain.py",  # starts none
}


@pytest.mark.parametrize(
    "command",
    [own_command("qrobot", "--version"), [sys.executable, *_CHECKER[:-1], "import qrobot.servo.laws.checker"]],
)
def test_a_users_file_called_as_a_module_of_the_library_is_not_run(tmp_path: Path, command: list[str]) -> None:
    programs = tmp_path / "programs"
    programs.mkdir()
    for name in sys.stdlib_module_names:
        (programs / f"{name}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'a').write({name!r})\n")
    done = subprocess.run(command, cwd=programs, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert not (tmp_path / "ran").exists()


def test_every_process_is_started_so() -> None:
    others = {
        str(path.relative_to(PACKAGE))
        for path in PACKAGE.rglob("*.py")
        if "sys.executable" in path.read_text() and path.name != "own_process.py"
    }
    assert others == OTHERS
