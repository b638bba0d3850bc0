"""Programs in C++ that include `<arcl.h>`, watched by the address sanitizer."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from qrobot.cli import toolchain
from tests.support.arcl import run_c
from tests.support.c_programs import needs_compiler, needs_cpp_compiler

SANITIZED = ("-O1", "-g", "-Wall", "-Wextra", "-Werror", "-fsanitize=address,undefined", "-fno-sanitize-recover")
KEPT = """\
#include <arcl.h>
#include <cstdio>
static ROBOT *opened(double pan)
{
    auto start = arcl_joints(pan, 90, -90., 0.f, 90l, 0);
    return arcl_open(ARCL_AMI, "offline", ARCL_START, start, 0);
}
int main()
{
    ROBOT *given = arcl_open(ARCL_AMI, "offline", ARCL_START, arcl_joints(0., 90., -90., 0., 90., 0.), 0);
    Trans *one = where(given), *other = where(opened(90.));
    std::printf("%.3f %.3f, %.3f\\n", one->t_p.x - other->t_p.y, one->t_p.y + other->t_p.x, one->t_p.z - other->t_p.z);
    return 0;
}
"""

pytestmark = [needs_compiler, pytest.mark.usefixtures("own_cache", "arcl_alone")]


@needs_cpp_compiler
@pytest.mark.parametrize("standard", ["c++11", "c++20"])
def test_the_numbers_of_a_list_live_as_long_as_the_value_that_has_them(standard: str, tmp_path: Path, capfd) -> None:
    (tmp_path / "kept.cc").write_text(KEPT)
    command = ["c++", f"-std={standard}", *SANITIZED, f"-I{toolchain.ARCL_INCLUDE}", str(tmp_path / "kept.cc")]
    library = toolchain.link_flags(["-fsanitize=address,undefined"])
    subprocess.run([*command, "-o", str(tmp_path / "kept"), *library], check=True)
    assert run_c(tmp_path / "kept", tmp_path) == 0
    assert "0.000 0.000, 0.000\n" in capfd.readouterr().out.replace("-0.000", "0.000")
