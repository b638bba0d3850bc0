"""`qrobot compile` fills the cache with all that a start and a first program need, and says where."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

import pytest

from qrobot.cli.arms import choose_arm, robot_of_arm
from qrobot.cli.compile import common_folder
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.cli.servo_settings import servo_settings
from qrobot.config import load_robot, robot_path
from qrobot.realtime import compiled_files, jit
from qrobot.rig import compile_everything

ROOT = Path(__file__).parents[3]
PROGRAM = """
import sys
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.realtime.compiled_files import USED_FOLDERS

def used():
    return {(folder, name) for folder, names in USED_FOLDERS.items() for name in names}

assert run_app(make_app(), ["compile", "--json"]) == 0
before = used()
assert run_app(make_app(), ["run", "--lockstep", "examples/01_park_and_return.py", "--output", sys.argv[1]]) == 0
print(sorted(used() - before), file=sys.stderr)
"""


@pytest.mark.skipif(jit.jit_disabled(), reason="nothing is compiled")
def test_a_first_program_needs_nothing_that_was_not_compiled_before(tmp_path: Path) -> None:
    command = [sys.executable, "-c", PROGRAM, str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, env=dict(os.environ), capture_output=True, text=True, check=True)
    told = json.loads(done.stdout[: done.stdout.index("\n}\n") + 2])
    assert done.stderr.splitlines()[-1] == "[]"
    assert told["programs"] == sum(told["folders"].values()) > 40
    assert all(folder.startswith(told["folder"]) for folder in told["folders"])


def test_without_a_compiler_or_a_folder_it_fails_with_the_remedy(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("qrobot.rig.compile_everything.stages", lambda *_: [])
    monkeypatch.setattr(compiled_files, "USED_FOLDERS", {})
    for disabled, remedy in ((False, "set NUMBA_CACHE_DIR to a folder"), (True, "NUMBA_DISABLE_JIT is set")):
        monkeypatch.setattr(jit, "jit_disabled", lambda disabled=disabled: disabled)
        assert run_app(make_app(), ["compile"]) == 1
        assert remedy in capsys.readouterr().err
    assert run_app(make_app(), ["compile", "nosuch"]) == 1


def test_the_folder_told_is_above_all_of_them() -> None:
    assert common_folder({"/a/b/__pycache__": set()}) == "/a/b/__pycache__"
    assert common_folder({"/a/b/__pycache__": set(), "/a/b/c/__pycache__": set()}) == "/a/b"


def test_an_arm_is_compiled_by_its_robot_file_whatever_name_stands_in_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, asked = tmp_path / "lab.toml", []
    file.write_text(robot_path("puma560").read_text().replace('name = "puma560"', 'name = "lab_arm"', 1))
    (tmp_path / "cell.toml").write_text(f'[[arm]]\nname = "lab"\nrobot = "{file}"\nbridge = {{ port = 5600 }}\n')
    arm = choose_arm(str(tmp_path / "cell.toml"), None)
    monkeypatch.setattr(compile_everything, "compile_motion", asked.append)
    monkeypatch.setattr(compile_everything, "compiled_beside", lambda name: asked.append(name) or nullcontext(str))
    for name, compile_it in compile_everything.stages(arm, robot_of_arm(arm), servo_settings(arm)):
        if "lock-step" in name or "program" in name:
            compile_it()
    assert [load_robot(each).name for each in asked] == ["lab_arm"] * 2
