"""Programs in C, compiled for the tests and served in this process."""

from __future__ import annotations

import os
import re
import runpy
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from qrobot import rccl, rci
from qrobot.arrays import Floats
from qrobot.cli import toolchain
from qrobot.rccl.c.program import run_executable
from qrobot.rccl.offline import OfflineLink
from qrobot.rccl.trace import Trace
from tests.support.patience import PATIENCE_S

EXAMPLES = Path(__file__).parents[2] / "examples"
CHECKED = ("-O0", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover")  # a leak or a stray access: status 1
FOUND = 99  # exit status of a program in which valgrind has found something
VALGRIND = (
    "valgrind --quiet --fair-sched=try --leak-check=full --errors-for-leak-kinds=definite,possible"
    f" --error-exitcode={FOUND}"
)
EDITS = (
    (r'#include "rccl.h"\n', '#include "rccl.h"\n\nMANIP *arm;\n'),
    (r"\bmain\(\)\n{([^=(]*;\n)?", r'main()\n{\1\n    arm = rccl_open("puma560");\n    rccl_control(arm);'),
    (r"\bmove\((p1|p2)\)", r"trackingMode(arm); move(\1)"),  # S-05: where a sensor moves the goal
    (r"\b(move|setmode|setvel|setime|distance|update|comply|lock)\(", r"\1(arm, "),
    (r'\bmakeposition\("\w+", ', "makePosition("),
    (r"\bt6->", "arm->trans."),
    (r"\bt6\b", "TRANS"),
    (r"\bpark\b", 'rccl_pose(arm, "park")'),
    (r"\b(completed|nbrequest|nextmove)\b", r"arm->\1"),
    (r"\bOPEN\b", "OPEN(arm);"),
    (r"\bCLOSE\b", "GRASP(arm);"),
    (r"\bhow\.time\b", "0."),  # there is no clock of the program's
)
"""What a program of one arm needs in Multi-RCCL, as docs/how-to/two-arms.md says."""
needs_compiler = pytest.mark.skipif(not shutil.which("cc"), reason="no C compiler: apt install gcc libc6-dev")

needs_cpp_compiler = pytest.mark.skipif(not shutil.which("c++"), reason="no C++ compiler: apt install g++")

needs_valgrind = pytest.mark.skipif(not shutil.which("valgrind"), reason="no valgrind: apt install valgrind")


def compiled(source: Path, folder: Path, *flags: str) -> Path:
    """The program made of a source."""
    target = folder / source.stem
    command = toolchain.command_line([*flags, str(source), "-o", str(target)])
    subprocess.run(command, check=True)
    return target


def edited_for_manipulators(source: Path) -> str:
    """A program of RCCL 1.0 with the small edits that make it one of Multi-RCCL."""
    text = source.read_text()
    for old, new in EDITS:
        text = re.sub(old, new, text)
    return text


def compiled_text(text: str, folder: Path, *flags: str, name: str = "program") -> Path:
    """The program made of a text, after the line that includes rccl.h."""
    source = folder / f"{name}.c"
    source.write_text(f'#include "rccl.h"\n{text}')
    return compiled(source, folder, *flags)


def ran(program: Path) -> tuple[int, str, str]:
    """Exit status, output and messages of a program that nobody serves."""
    done = subprocess.run([program], check=False, capture_output=True, text=True, timeout=PATIENCE_S)
    return done.returncode, done.stdout, done.stderr


def under_valgrind(program: Path) -> Path:
    """The same, watched: what it does wrong becomes its exit status."""
    watched = program.with_suffix(".sh")
    watched.write_text(f'#!/bin/sh\nexec {VALGRIND} {program} "$@"\n')
    watched.chmod(0o755)
    return watched


def offline(start: Callable[[], object]) -> tuple[object, list[Trace]]:
    """What a program gives that is run off line, and what it has done with each arm it took."""
    traces: list[Trace] = []
    with rccl.use(OfflineLink, traces), rci.use(OfflineLink):
        try:
            return start(), traces
        finally:
            rccl.release()


@contextmanager
def keyboard(typed: str) -> Iterator[None]:
    """What somebody types at the terminal of this process and of its children."""
    before = os.dup(0)
    reading, writing = os.pipe()
    os.write(writing, typed.encode())
    os.close(writing)
    os.dup2(reading, 0)
    os.close(reading)
    try:
        yield
    finally:
        os.dup2(before, 0)
        os.close(before)


def way_of_c(program: Path, *arguments: str) -> Floats:
    """Setpoints of a program in C that ends well, rad. Shape (samples, n)."""
    status, traces = offline(lambda: run_executable(program, arguments))
    assert status == 0
    (trace,) = traces
    return trace.setpoints.q


def way_of_python(name: str) -> Floats:
    """Setpoints of an example in Python, rad. Shape (samples, n)."""
    _, (trace,) = offline(lambda: runpy.run_path(str(EXAMPLES / name), run_name="__main__"))
    return trace.setpoints.q
