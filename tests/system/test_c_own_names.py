"""Functions of a program in C that are called as some of the library: the library calls its own, not those."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from qrobot.cli import toolchain
from qrobot.rccl.c.program import run_executable
from tests.support.c_programs import CHECKED, compiled_text, needs_compiler, offline

OPTIONAL = {"arcl_obey", "arcl_cell_place", "rccl_has_manipulators"}  # which a library has, or has not
OWN = """
#undef control
#undef release
static int called;
control() { called++; }
release() { called++; }
main(argc, argv) char **argv;
{
    int counts[RCCL_JOINTS] = {0}, c = argc > 1 ? argv[1][0] : 0;
    real angles[RCCL_JOINTS] = {0};
    double thresholds[RCCL_JOINTS] = {9., 9., 9., 2., 2., 2.};
    switch (c) {
    case 'e': enctoang(angles, counts); break;
    case 'a': angtoenc(counts, angles); break;
    case 'c': rccl_collision("stop", 0., thresholds); break;
    case 'w': how.n = 1000; enctoang(angles, counts); break;
    case 'v': how.n = -1; rccl_collision("stop", 0., thresholds); break;
    case 'n': angles[2] = 0. / 0.; angtoenc(counts, angles); break;
    case 'f': angles[2] = 1e20; angtoenc(counts, angles); break;
    }
    printf("%d %d\\n", how.n, called);
    return 0;
}
"""
TASK = """
#undef control
static int called;
control() { called++; }
pumatask() { printf("%d %d\\n", how.n, called); }
"""
OF_THE_SYSTEM = """
open() { OPEN return 0; }
close() { CLOSE return 0; }
main() { open(); close(); printf("%d\\n", chg.hand); return 0; }
"""
WRITTEN = "how.n is no number of joints any more"
NO_COUNTS = "angtoenc: an angle is no number, or its counts are more than fit into an int"

pytestmark = [needs_compiler, pytest.mark.usefixtures("own_cache")]


def test_no_source_of_the_library_calls_a_function_that_a_program_may_have_itself() -> None:
    library = toolchain.library(toolchain.compiler())
    symbols = subprocess.run(["nm", library], capture_output=True, text=True, check=True).stdout
    weak = set(re.findall(r"^[0-9a-f]+ W (\w+)$", symbols, re.MULTILINE)) - OPTIONAL
    assert {"control", "move", "rccl_newtrans", "rccl_manip_move", "arcl_free", "arcl_list_move"} <= weak
    wanted = subprocess.run(["objdump", "-r", library], capture_output=True, text=True, check=True).stdout
    sections = re.split(r"^RELOCATION RECORDS FOR \[(.*?)\]:$", wanted, flags=re.MULTILINE)[1:]
    of_code = "".join(text for name, text in zip(sections[::2], sections[1::2], strict=True) if ".text" in name)
    assert "shim_call" in of_code
    assert set(re.findall(r"\s(\w+)(?:[-+]0x[0-9a-f]+)?$", of_code, re.MULTILINE)) & weak == set()


@pytest.fixture(scope="module")
def own(own_cache: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled_text(OWN, tmp_path_factory.mktemp("own"), *CHECKED)


@pytest.mark.parametrize("call", ["e", "a", "c"])
def test_a_call_that_takes_the_arm_needs_no_control_that_is_the_programs_own(call: str, own: Path, capfd) -> None:
    status, traces = offline(lambda: run_executable(own, (call,)))
    assert (status, capfd.readouterr().out, len(traces)) == (0, "6 0\n", 1)


def test_the_main_of_a_pumatask_takes_the_arm_too(tmp_path: Path, capfd) -> None:
    status, traces = offline(lambda: run_executable(compiled_text(TASK, tmp_path), ()))
    assert (status, capfd.readouterr().out, len(traces)) == (0, "6 0\n", 1)


def test_open_and_close_of_a_hand_get_other_names_by_an_option(tmp_path: Path, capfd) -> None:
    program = compiled_text(OF_THE_SYSTEM, tmp_path, "-Dopen=open_hand", "-Dclose=close_hand")
    status, _ = offline(lambda: run_executable(program, ()))
    assert (status, capfd.readouterr().out) == (0, "2\n")


@pytest.mark.parametrize(("call", "told"), [("w", WRITTEN), ("v", WRITTEN), ("n", NO_COUNTS), ("f", NO_COUNTS)])
def test_numbers_that_no_array_or_encoder_has_end_the_program(call: str, told: str, own: Path, capfd) -> None:
    status, _ = offline(lambda: run_executable(own, (call,)))
    assert status == 1
    assert told in capfd.readouterr().err
