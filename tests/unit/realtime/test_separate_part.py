"""A part of a program has machine code of its own: compiled once, shared by all that call it, found again from disk."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from qrobot.config import load_robot
from qrobot.realtime.jit import jit_disabled, lean_kernel, part_kernel
from qrobot.rig.compile_ahead import PARTS, argument_types, compile_parts
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.settings import ServoSettings

pytestmark = pytest.mark.skipif(jit_disabled(), reason="nothing is compiled")

PROGRAM = """
from qrobot.realtime.jit import lean_kernel, part_kernel

@lean_kernel
def scaled(x):
    return {factor} * x

@part_kernel
def part(x, n):
    return scaled(x) + n

@lean_kernel
def whole(x):
    return part(x, 1) + part(x, 2)
"""
SHOW = "import program as p; print(p.whole(2.0), sum(p.whole.stats.cache_hits.values()))"

SIZES = """
import numpy as np
from qrobot.realtime.jit import lean_kernel, part_kernel

def block(n):
    return np.ones(1, np.dtype([("x", np.float64, (n,))]))

@part_kernel
def length(block):
    return block[0].x.size

@lean_kernel
def total(block):
    return length(block)
"""


@lean_kernel
def tripled(x: Any) -> Any:
    return 3 * x


@part_kernel
def one_more(x: Any, n: int) -> Any:
    return tripled(x) + n


@lean_kernel
def first(x: Any) -> Any:
    return one_more(x, 1) + one_more(x, 2)


@lean_kernel
def second(x: Any) -> Any:
    return one_more(x, 3)


class Programs:
    """Versions of a program in a folder, run by processes of their own that share a cache."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def run(self, show: str = SHOW, factor: int = 3) -> str:
        (self.folder / "program.py").write_text(PROGRAM.format(factor=factor))
        environment = {"PYTHONPATH": f"{self.folder}:{Path(__file__).parents[3]}", "PYTHONDONTWRITEBYTECODE": "1"}
        environment |= {"NUMBA_CACHE_DIR": str(self.folder / "cache"), "HOME": str(self.folder)}
        command = [sys.executable, "-c", show]
        done = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, text=True)
        return done.stdout.strip()

    def cached(self, name: str) -> list[Path]:
        return sorted(self.folder.glob(f"cache/*/program.{name}-*.nbc"))


@pytest.fixture
def programs(tmp_path: Path) -> Programs:
    return Programs(tmp_path)


def test_all_that_call_a_part_share_its_code() -> None:
    assert (first(2.0), second(2.0)) == (15.0, 9.0)
    (result,) = one_more.overloads.values()  # type: ignore[attr-defined]
    name = result.fndesc.llvm_func_name
    for caller in (first, second):
        caller.recompile()  # type: ignore[attr-defined]
        assert caller(2.0) in (15.0, 9.0)
        (whole,) = caller.overloads.values()  # type: ignore[attr-defined]
        assert whole.library._final_module.get_function(name).is_declaration


def test_a_part_can_be_called_from_python() -> None:
    assert one_more(2.0, 5) == 11.0


def test_a_later_process_finds_program_and_part_on_disk(programs: Programs) -> None:
    assert [programs.run(), programs.run()] == ["15.0 0", "15.0 1"]


@pytest.mark.thorough
def test_a_part_that_is_lost_is_compiled_again_under_the_name_that_its_program_knows(programs: Programs) -> None:
    programs.run()
    for path in programs.cached("part"):
        path.unlink()
    again = "import numba; numba.njit(lambda x: x)(1); " + SHOW  # kernels have other numbers than before
    assert programs.run(again) == "15.0 1"


@pytest.mark.thorough
def test_a_changed_kernel_below_a_part_makes_program_and_part_stale(programs: Programs) -> None:
    assert [programs.run(factor=3), programs.run(factor=5)] == ["15.0 0", "23.0 0"]


@pytest.mark.thorough
def test_a_part_is_not_taken_for_one_of_other_types_that_another_process_compiled(programs: Programs) -> None:
    """Two processes number their types alike, so that Numba gives one name to code for different records."""
    (programs.folder / "sizes.py").write_text(SIZES)
    for n in (3, 7):
        assert programs.run(f"import sizes as s; print(s.total(s.block({n})))") == str(n)
    both = "b = s.block(3), s.block(7); print(*map(s.length, b), *map(s.total, b), len(s.total.stats.cache_hits))"
    assert programs.run(f"import sizes as s; {both}") == "3 7 3 7 2"


def test_the_parts_compiled_ahead_are_those_of_the_loop() -> None:
    rig = LockstepRig(load_robot("puma560"), ServoSettings())
    rig.compile()
    used = {part: list(part.overloads) for part in PARTS}
    assert all(used.values())
    compile_parts("puma560")
    assert {part: list(part.overloads) for part in PARTS} == used
    assert {"params", "state", "mail"} < set(argument_types(rig))


def test_a_part_that_another_process_compiles_is_left_to_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Locks of one process do not hinder itself, so that the other one has to be one."""
    asked: list[object] = []
    for part in PARTS:
        monkeypatch.setattr(part, "compile", lambda _, part=part: asked.append(part))
    busy = PARTS[1]
    place = str(Path(busy._cache.cache_path)), busy._cache._cache_file._index_name
    hold = "import sys; from pathlib import Path; from qrobot.realtime.compile_once import lock_of\n"
    hold += f"with lock_of(Path({place[0]!r}), {place[1]!r}): print('held', flush=True); input()"
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", hold], **pipes) as other:  # type: ignore[call-overload]
        assert other.stdout.readline() == "held\n"
        compile_parts("puma560")
        assert asked == [part for part in PARTS if part is not busy]
        other.communicate("\n")
    compile_parts("puma560")
    assert asked[len(PARTS) - 1 :] == list(PARTS)
