"""The same work in C: sources beside this file, compiled where there is a compiler, called without the interpreter."""

from __future__ import annotations

import atexit
import ctypes
import platform
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from typing import Final

SOURCES: Final = Path(__file__).parent / "c"
OPTIONS: Final = ("-O3", "-march=native", "-shared", "-fPIC")
# With 512-bit registers GCC 12 calls libm's tanh without clearing their upper halves: each call then takes ten times
# as long. Without this option the comparison would flatter Numba.
X86_OPTIONS: Final = ("-mno-avx512f",)


@cache
def compiler() -> str | None:
    """A C compiler of this machine; None when there is none."""
    return next(filter(None, map(shutil.which, ("gcc", "cc", "clang"))), None)


@cache
def _folder() -> Path:
    folder = tempfile.TemporaryDirectory(prefix="qrobot-bench-")
    atexit.register(folder.cleanup)
    return Path(folder.name)


@cache
def twin(name: str) -> ctypes.CDLL | None:
    """The library of `c/name.c`; None without a compiler. Raises CalledProcessError when it does not compile."""
    program = compiler()
    if program is None:
        return None
    options = OPTIONS + (X86_OPTIONS if platform.machine() in ("x86_64", "AMD64") else ())
    library = _folder() / f"{name}.so"
    subprocess.run([program, *options, str(SOURCES / f"{name}.c"), "-o", str(library), "-lm"], check=True)
    return ctypes.CDLL(str(library))


def pointer(array: object) -> ctypes.c_void_p:
    """Where the data of a NumPy array are, for a C function."""
    return ctypes.c_void_p(array.ctypes.data)  # type: ignore[attr-defined]
