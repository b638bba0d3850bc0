"""A cache that is full, damaged, not to be written or of another processor hinders no kernel."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from qrobot.realtime import compiled_files
from qrobot.realtime.compiled_files import CompiledFiles, processor_digest
from qrobot.realtime.jit import jit_disabled, kernel

pytestmark = pytest.mark.skipif(jit_disabled(), reason="nothing is compiled")

ROOT = Path(__file__).parents[3]
PROGRAM = """
import warnings
warnings.simplefilter("error")
from qrobot.realtime.jit import lean_kernel

@lean_kernel
def inner(x):
    return 2.0 * x

@lean_kernel
def outer(x):
    return inner(x) + 1.0

print(outer(2.0), sum(outer.stats.cache_hits.values()), len(inner.callee.overloads))
"""
COMPILED, LOADED = "5.0 0 1", "5.0 1 0"


class Program:
    """A program in a folder with its cache, each run a process of its own."""

    def __init__(self, folder: Path) -> None:
        self.cache = folder / "cache"
        (folder / "program.py").write_text(PROGRAM)
        self.environment = os.environ | {"NUMBA_DISABLE_JIT": "0", "PYTHONPATH": f"{ROOT}{os.pathsep}{folder}"}
        self.environment |= {"PYTHONDONTWRITEBYTECODE": "1", "NUMBA_CACHE_DIR": str(self.cache)}

    def run(self, **environment: str) -> str:
        command = [sys.executable, "-c", "import program"]
        done = subprocess.run(command, env=self.environment | environment, check=True, capture_output=True, text=True)
        return done.stdout.strip()

    def files(self, ending: str) -> list[Path]:
        return sorted(self.cache.glob(f"*/*{ending}"))


@pytest.fixture
def program(tmp_path: Path) -> Program:
    return Program(tmp_path)


def cut(whole: bytes) -> bytes:
    return whole[: len(whole) // 2]


def flip_a_bit(whole: bytes) -> bytes:
    middle = len(whole) // 2
    return whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :]


def test_a_damaged_file_counts_as_none_and_is_made_anew(program: Program) -> None:
    program.run()
    for ending, damage in ((".nbc", cut), (".nbc", flip_a_bit), (".nbi", cut)):
        (file,) = program.files(ending)
        file.write_bytes(damage(file.read_bytes()))
        assert program.run() == COMPILED
    assert program.run() == LOADED


def test_processors_of_two_kinds_share_a_folder_but_no_file(program: Program) -> None:
    other = {"NUMBA_CPU_NAME": "nehalem", "NUMBA_CPU_FEATURES": ""}  # older than any that has AVX
    assert [program.run(), program.run(**other)] == [COMPILED, COMPILED]
    assert [program.run(), program.run(**other)] == [LOADED, LOADED]
    own, others = sorted(program.files(".nbi"), key=lambda file: processor_digest() not in file.name)
    own.write_bytes(others.read_bytes())  # even then: the index says which processor each code is for
    assert program.run() == COMPILED


def test_without_a_folder_that_can_be_written_kernels_still_share_what_is_below_them(tmp_path: Path) -> None:
    """Of the program nothing can be kept, as in an installation that belongs to somebody else and without a home."""
    program = Program(tmp_path)
    nowhere = "import numba.core.caching as c; c.CacheImpl._locator_classes.clear(); "
    command = [sys.executable, "-c", f"{nowhere} import program"]
    done = subprocess.run(command, env=program.environment, check=True, capture_output=True, text=True)
    assert (done.stdout.strip(), program.files("")) == (COMPILED, [])


def test_a_full_disk_is_told_and_the_kernel_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    @kernel
    def doubled(x: float) -> float:
        return 2.0 * x

    def no_space(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(CompiledFiles, "_open_for_write", no_space)
    with pytest.warns(RuntimeWarning, match=r"cannot be kept in .*No space left on device.*compiles it again"):
        assert doubled(2.0) == 4.0
    assert doubled(3.0) == 6.0


def test_code_of_other_sources_is_not_read_even_under_its_name(tmp_path: Path) -> None:
    """A process that was killed between index and code leaves an index that names an older version's file."""
    CompiledFiles(str(tmp_path), "kernel", "old").save("key", "old code")
    new = CompiledFiles(str(tmp_path), "kernel", "new")
    new._save_index({"key": new._data_name(1)})
    assert new.load("key") is None
    new.save("key", "new code")
    assert new.load("key") == "new code"


def test_the_name_of_a_file_tells_the_processor(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled_files.processor_digest.cache_clear()
    here = processor_digest()
    monkeypatch.setattr("numba.core.config.CPU_NAME", "nehalem")
    compiled_files.processor_digest.cache_clear()
    there = processor_digest()
    compiled_files.processor_digest.cache_clear()
    assert here != there
