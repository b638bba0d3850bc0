"""A cache that is full, damaged, not to be written or of another processor hinders no kernel."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
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

print(outer(2.0), sum(outer.stats.cache_hits.values()), len(inner.callee().overloads))
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


class Unreadable:
    """Contents that end in a MemoryError when they are read."""

    def __reduce__(self) -> tuple[Any, ...]:
        return run_out_of_memory, ()


def run_out_of_memory() -> None:
    raise MemoryError


def cut(whole: bytes) -> bytes:
    return whole[: len(whole) // 2]


def flip_a_bit(whole: bytes) -> bytes:
    middle = len(whole) // 2
    return whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :]


@pytest.mark.thorough
def test_a_damaged_file_counts_as_none_and_is_made_anew(program: Program) -> None:
    """Every other damage is looked at without a process below: of the code, and of the index."""
    program.run()
    for ending, damage in ((".nbc", cut), (".nbi", flip_a_bit)):
        (file,) = program.files(ending)
        file.write_bytes(damage(file.read_bytes()))
        assert program.run() == COMPILED
    assert program.run() == LOADED


@pytest.mark.thorough
def test_processors_of_two_kinds_share_a_folder_but_no_file(program: Program) -> None:
    other = {"NUMBA_CPU_NAME": "nehalem", "NUMBA_CPU_FEATURES": ""}  # older than any that has AVX
    assert [program.run(), program.run(**other)] == [COMPILED, COMPILED]
    assert [program.run(), program.run(**other)] == [LOADED, LOADED]
    own, others = sorted(program.files(".nbi"), key=lambda file: processor_digest() not in file.name)
    own.write_bytes(others.read_bytes())  # even then: the index says which processor each code is for
    assert program.run() == COMPILED


READ_ONLY = """
import os, sys, tempfile
make = tempfile.TemporaryFile

def refuse(dir):
    if dir.startswith(tuple(os.environ["READ_ONLY"].split(":"))):
        raise PermissionError(13, "Permission denied", dir)
    return make(dir=dir)

tempfile.TemporaryFile = refuse  # what tells whether a folder can be written: root can write where nobody else may
import program
if program.outer(2) == 5 and sys.argv[1:]:
    print(sum(program.outer.stats.cache_hits.values()))
"""


def run_where(program: Program, read_only: Path, *words: str, user: Path) -> list[str]:
    """What it prints when a folder cannot be written, for floats and, where there are words, for integers."""
    environment = program.environment | {"READ_ONLY": str(read_only), "XDG_CACHE_HOME": str(user), "HOME": str(user)}
    command = [
        sys.executable,
        "-W",
        "error",
        "-c",
        READ_ONLY if words else READ_ONLY.partition("if program")[0],
        *words,
    ]
    return subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout.split("\n")[:-1]


def test_without_a_folder_that_can_be_written_kernels_still_share_what_is_below_them(tmp_path: Path) -> None:
    """Of the program nothing can be kept, as in an installation that belongs to somebody else and without a home."""
    program = Program(tmp_path)
    assert (run_where(program, Path("/"), user=tmp_path / "user"), program.files("")) == ([COMPILED], [])


@pytest.mark.thorough
def test_a_folder_that_somebody_else_filled_is_read_and_what_it_lacks_is_kept_in_the_users_own(tmp_path: Path) -> None:
    program, user = Program(tmp_path), tmp_path / "user"
    program.run()
    filled = program.files("")
    for read_only in (tmp_path, tmp_path / "cache"):  # nothing can be written, then the user's folder can
        assert run_where(program, read_only, "integers", user=user) == [LOADED, "1"]
    assert run_where(program, tmp_path / "cache", "integers", user=user) == [LOADED, "2"]
    assert program.files("") == filled


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


def test_an_index_with_any_byte_changed_or_cut_off_counts_as_none(tmp_path: Path) -> None:
    files = CompiledFiles(str(tmp_path), "kernel", "stamp")
    files.save("key", "code")
    path, whole = Path(files._index_path), Path(files._index_path).read_bytes()
    chance = np.random.default_rng(1)
    for place in range(len(whole)):
        changed = whole[:place] + bytes([whole[place] ^ int(chance.integers(1, 256))]) + whole[place + 1 :]
        for damaged in (changed, whole[:place]):
            path.write_bytes(damaged)
            assert files.load("key") is None
    path.write_bytes(whole)
    assert files.load("key") == "code"


def test_code_with_any_byte_changed_or_cut_off_counts_as_none(tmp_path: Path) -> None:
    files = CompiledFiles(str(tmp_path), "kernel", "stamp")
    files.save("key", "code")
    path = Path(files._data_path(files._data_name(1)))
    whole = path.read_bytes()
    for place in range(len(whole)):
        for damaged in (whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :], whole[:place]):
            path.write_bytes(damaged)
            assert files.load("key") is None
    path.write_bytes(whole)
    assert files.load("key") == "code"


def test_what_cannot_be_read_although_it_is_whole_counts_as_none(tmp_path: Path) -> None:
    """A class of the past may end in any error."""
    files = CompiledFiles(str(tmp_path), "kernel", "stamp")
    files.save("key", Unreadable())
    assert files.load("key") is None


def test_code_of_another_signature_is_not_taken(tmp_path: Path) -> None:
    """Neither from a file that was copied, nor through an index that leads to the wrong one."""
    files = CompiledFiles(str(tmp_path), "kernel", "stamp")
    files.save("of int64", "code for int64")
    files.save("of float64", "code for float64")
    ints, reals = (Path(files._data_path(files._data_name(number))) for number in (1, 2))
    ints.write_bytes(reals.read_bytes())
    assert (files.load("of int64"), files.load("of float64")) == (None, "code for float64")
    files.save("of int64", "code for int64")
    assert files.load("of int64") == "code for int64"
    files._save_index({"of int64": files._data_name(2)})
    assert files.load("of int64") is None
    Path(files._index_path).write_bytes(ints.read_bytes())
    assert files.load("of int64") is None


def test_code_of_another_kernel_of_the_same_sources_is_not_taken(tmp_path: Path) -> None:
    """The key has the instructions of a kernel and not its constants: two kernels can have equal ones."""
    one, other = (CompiledFiles(str(tmp_path), name, "stamp") for name in ("one", "other"))
    one.save("key", "one")
    other.save("key", "other")
    for path in ("_index_path", "_data_name"):
        mine, theirs = (_path_of(files, path) for files in (one, other))
        mine.write_bytes(theirs.read_bytes())
        assert (one.load("key"), other.load("key")) == (None, "other")
        one.save("key", "one")


def _path_of(files: CompiledFiles, what: str) -> Path:
    return Path(files._index_path if what == "_index_path" else files._data_path(files._data_name(1)))


def test_the_name_of_a_file_tells_the_processor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def named() -> str:
        return Path(CompiledFiles(str(tmp_path), "kernel", "stamp")._index_path).name

    compiled_files.processor_digest.cache_clear()
    here, file_here = processor_digest(), named()
    monkeypatch.setattr("numba.core.config.CPU_NAME", "nehalem")
    compiled_files.processor_digest.cache_clear()
    there, file_there = processor_digest(), named()
    compiled_files.processor_digest.cache_clear()
    assert here != there
    assert (file_here, file_there) == (f"kernel.{here}.nbi", f"kernel.{there}.nbi")
