"""The C compiler, and the library that C programs are linked with.

The library is compiled on the machine of whoever compiles C, once for each compiler and choice of instrumentation, into
the user's cache.
"""

from __future__ import annotations

import hashlib
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Literal, TypeAlias

from qrobot.config import robot_path
from qrobot.errors import ConfigError
from qrobot.rci.c.robot_table import TABLE_MAKER, robot_files, robot_table

HERE: Final = Path(__file__).parents[1]
INCLUDE: Final = HERE / "rccl" / "c" / "include"
SOURCES: Final = HERE / "rccl" / "c" / "shim"
RCI: Final = HERE / "rci" / "c"
ARCL_INCLUDE: Final = HERE / "arcl" / "c" / "include"
ARCL_SOURCES: Final = HERE / "arcl" / "c" / "shim"
MULTI_INCLUDE: Final = HERE / "multi_rccl" / "c" / "include"
MULTI_SOURCES: Final = HERE / "multi_rccl" / "c" / "shim"
WIRE: Final = HERE / "wire" / "c"
"""Of the header of the wire protocol's client."""
LEGACY: Final = ("-std=gnu99", "-fgnu89-inline", "-fcommon", "-fwrapv", "-fno-strict-aliasing", "-pthread")
"""C as it was: implicit int, K&R definitions, variables defined in several files, arithmetic that wraps.

Not gnu89, in which a `main` that falls off its end returns whatever a register holds: since C99 (5.1.2.2.3) it is 0.
"""
QUIET: Final = "-w"
PERMISSIVE: Final = "-fpermissive"
"""What gcc 14 and later needs to take C as it was without -std=gnu89; gcc before does not know it in C, and says so
where it may say anything."""
PERMISSIVE_SINCE: Final = 14
TOLERATED: Final = (
    "implicit-int",
    "implicit-function-declaration",
    "return-type",
    "return-mismatch",
    "int-conversion",
    "incompatible-pointer-types",
    "incompatible-function-pointer-types",
)
"""What clang takes for errors (clang 19), and gcc 14 too without -fpermissive."""
STRICT: Final = ("-std=gnu11", "-O2", "-gdwarf-4", "-Wall", "-Wextra", "-fPIC", "-pthread")
"""Of the library. Valgrind before 3.20 gives up at what clang writes for debuggers of today, hence DWARF 4."""
LIBRARY: Final = "qrobot_rccl"
Release: TypeAlias = Literal["auto", "1.0", "multi"]
"""Which rccl.h: of one arm, of several manipulators, or whichever the sources want."""
_NO_CODE: Final = re.compile(r'/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\\n])*"', re.DOTALL)
_OF_MANIPULATORS: Final = re.compile(r"\b(?:MANIP(?:_PTR)?|rccl_open|makePosition(?:For)?|trackingMode)\b")
"""Words that only programs of Multi-RCCL have."""
_INSTRUMENTATION: Final = ("-fsanitize", "-m")
_OTHER_LAYOUT: Final = frozenset(("-m32", "-mx32", "-m16", "-mabi=ilp32", "-fpack-struct"))
"""Options by which structures lie otherwise than the motion engine reads them; the headers find the others."""
_SANITIZED: Final = ("-O1", "-fno-omit-frame-pointer")  # gcc 12 took 14 s with -O2 and 5 s with -O1 (2026-11-29)
_NO_LINKING: Final = frozenset(("-c", "-S", "-E", "-M", "-MM", "-fsyntax-only", "--version", "-dumpversion"))


def compiler() -> list[str]:
    """The C compiler's command: that of the variable CC, or cc. Raises ConfigError: there is none, or for another
    layout."""
    command = shlex.split(os.environ.get("CC", "cc"))
    _check_layout(command)
    if not command or shutil.which(command[0]) is None:
        name = command[0] if command else "''"
        raise ConfigError(
            f"no C compiler {name}: install one (Debian, Ubuntu: apt install gcc libc6-dev; Fedora: dnf install gcc), "
            "or name yours in the variable CC"
        )
    return command


def _check_layout(words: Sequence[str]) -> None:
    for word in words:
        if word in _OTHER_LAYOUT:
            raise ConfigError(
                f"{word}: the motion engine reads structures of a program as a compiler lays them out for 64 bits; "
                f"leave {word} out"
            )


def has_manipulators(arguments: Sequence[str]) -> bool:
    """Whether sources among the arguments of a compiler are of Multi-RCCL: they open manipulators, or name them."""
    sources = [Path(word) for word in arguments if word.endswith((".c", ".h")) and Path(word).is_file()]
    codes = (_NO_CODE.sub(" ", source.read_text(errors="replace")) for source in sources)
    return any(_OF_MANIPULATORS.search(code) for code in codes)


def compile_flags(arguments: Sequence[str] = (), release: Release = "auto") -> list[str]:
    """Compiler options for legacy sources of a release, silent unless `arguments` ask for warnings."""
    asked = any(word.startswith("-W") and not word.startswith("-Wl,") for word in arguments)
    multi = release == "multi" or (release == "auto" and has_manipulators(arguments))
    first = [f"-I{MULTI_INCLUDE}"] if multi else []
    return [*LEGACY, *(_as_warnings() if asked else _unsaid()), *first, *_includes()]


def _includes() -> list[str]:
    return [f"-I{folder}" for folder in (INCLUDE, ARCL_INCLUDE, RCI / "include", WIRE)]


def _unsaid() -> list[str]:
    """Options that silence the warnings; every compiler takes a -Wno- that it does not know."""
    return [QUIET, PERMISSIVE, *(f"-Wno-{name}" for name in TOLERATED)]


def _as_warnings() -> list[str]:
    """Options that turn the errors of today's compilers into warnings; gcc refuses unknown names here and has one for
    all."""
    if "clang" not in _answer_of([*compiler(), "--version"]):
        return [PERMISSIVE] * (int(_answer_of([*compiler(), "-dumpversion"]).partition(".")[0]) >= PERMISSIVE_SINCE)
    return ["-Wno-unknown-warning-option", *(f"-Wno-error={name}" for name in TOLERATED)]


def link_flags(arguments: Sequence[str] = (), robots: Sequence[Path] = ()) -> list[str]:
    """Linker options for programs in C; the library is compiled if need be. Raises ConfigError when that fails."""
    return [f"-L{library(compiler(), arguments, robots).parent}", f"-l{LIBRARY}", "-pthread", "-lm"]


def command_line(arguments: Sequence[str], robots: Sequence[Path] = (), release: Release = "auto") -> list[str]:
    """The whole command for these arguments of a compiler.

    Args:
        arguments: of the compiler.
        robots: files of robots that tasks of RCI are to know besides the packaged ones.
        release: of RCCL.

    Raises:
        ConfigError: no compiler, no library, a mistake in a robot file, or structures that would lie otherwise than the
            motion engine reads them.
    """
    _check_layout(arguments)
    linked = [] if _NO_LINKING & set(arguments) else link_flags(arguments, robots)
    return [*compiler(), *compile_flags(arguments, release), *arguments, *linked]


def package_file() -> str:
    """A file for pkg-config. Raises ConfigError: no compiler, or no library."""
    from importlib.metadata import version

    return "\n".join(
        (
            "Name: qrobot-rccl",
            "Description: RCCL and ARCL for programs in C, before the motion engine of qrobot",
            f"Version: {version('qrobot')}",
            f"Cflags: {shlex.join(compile_flags())}",
            f"Libs: {shlex.join(link_flags())}",
            "",
        )
    )


def library(cc: Sequence[str], arguments: Sequence[str] = (), robots: Sequence[Path] = ()) -> Path:
    """The library for a compiler, instrumented as in `arguments`. Raises ConfigError: it cannot be compiled."""
    flags = [*STRICT, *(word for word in arguments if word.startswith(_INSTRUMENTATION))]
    flags += _SANITIZED if any(word.startswith("-fsanitize") for word in flags) else ()
    flags += [*_includes(), f"-I{SOURCES}", f'-DQROBOT_PYTHON="{sys.executable}"']
    files = [*robot_files(), *map(robot_path, robots)]
    made = _cache() / _digest([*cc, _answer_of([*cc, "-dumpfullversion", "-dumpversion"]), *flags], files)
    path = made / f"lib{LIBRARY}.a"
    if not path.exists():
        _build(cc, flags, path, files)
    return path


def _build(cc: Sequence[str], flags: Sequence[str], path: Path, robots: Sequence[Path]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        table = Path(folder) / "rci_robot_table.c"
        table.write_text(robot_table(robots))
        sources = [*_sources(), table]
        objects = [f"{folder}/{source.parent.name}-{source.stem}.o" for source in sources]
        for source, target in zip(sources, objects, strict=True):
            _answer_of([*cc, *flags, "-c", str(source), "-o", target])
        _answer_of(["ar", "rcs", f"{folder}/library.a", *objects])
        os.replace(f"{folder}/library.a", path)  # whole or not at all, whoever else compiles it now


def _sources() -> list[Path]:
    folders = (SOURCES, MULTI_SOURCES, ARCL_SOURCES, RCI / "src")
    return [source for folder in folders for source in sorted(folder.glob("*.c"))]


def _cache() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "qrobot" / "cc"


def _digest(words: Sequence[str], robots: Sequence[Path]) -> str:
    folders = (SOURCES, ARCL_SOURCES, INCLUDE, MULTI_INCLUDE, ARCL_INCLUDE, RCI / "src", RCI / "include", WIRE)
    headers = [path for folder in folders for path in sorted(folder.glob("*.h"))]
    told = [*words, *map(str, robots)]
    texts = [path.read_bytes() for path in (*_sources(), *headers, TABLE_MAKER, *robots)]
    return hashlib.sha256("\0".join(told).encode() + b"\0".join(texts)).hexdigest()[:16]


def _answer_of(command: Sequence[str]) -> str:
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    except FileNotFoundError as error:
        raise ConfigError(f"{command[0]} is missing: install it (Debian, Ubuntu: apt install gcc libc6-dev)") from error
    except subprocess.CalledProcessError as error:
        raise ConfigError(f"{shlex.join(command)}: {error.stderr}") from error
    return done.stdout.strip()
