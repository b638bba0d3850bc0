"""What works without the extras of the package, and what is said where one is missing."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from qrobot.extras import EXTRAS

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]

COMPILED = {"gamepad"}  # when it is installed: no demo and no test may need a compiler
WITHOUT_EXTRAS = f"""
import importlib, pkgutil, sys
for name in {sorted(EXTRAS)}:
    sys.modules[name] = None  # `import name` fails from here on
"""

CORE = """
import qrobot.rccl, qrobot.rccl_bridge.server, qrobot.servo.process.daemon, qrobot.servo.process.guardian
import qrobot.log.follow, qrobot.rig.processes
from qrobot.cli.main import COMMANDS
for command in COMMANDS:
    importlib.import_module(command.target.partition(":")[0])
from qrobot.config import load_robot
from qrobot.servo.laws.shipped import find_law
find_law("qrobot", load_robot("puma560"))
"""


def python(program: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", WITHOUT_EXTRAS + program], capture_output=True, text=True, timeout=300, check=False
    )


def test_servo_bridge_recorder_and_every_command_are_there_without_any_extra() -> None:
    done = python(CORE)
    assert done.returncode == 0, done.stderr


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("words", "remedy"),
    [
        (["demo", "--lockstep"], r"pip install 'qrobot\[emulator\]'"),
        (["study", "identify", "--arms", "1"], r"pip install 'qrobot\[\w+\]'"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_a_command_that_needs_an_extra_says_which_in_one_line(words: list[str], remedy: str, tmp_path: Path) -> None:
    words = [*words, *(["--out-dir", str(tmp_path)] if words[0] == "demo" else ["--output", str(tmp_path / "s.jsonl")])]
    done = python(f"from qrobot.cli.main import main; sys.argv[1:] = {words}; sys.exit(main())")
    assert done.returncode == 1, done.stderr
    assert re.search(remedy, done.stderr.splitlines()[-1]), done.stderr
    assert "Traceback" not in done.stderr


def test_each_extra_that_is_named_exists_and_is_part_of_a_development_installation() -> None:
    named = {extra.name for extra in EXTRAS.values()}
    assert named <= set(PROJECT["optional-dependencies"])
    everything = re.search(r"qrobot\[(.*)\]", PROJECT["optional-dependencies"]["dev"][0])
    assert everything is not None
    assert named - COMPILED == set(everything[1].split(","))
