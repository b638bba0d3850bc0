"""`qrobot cc`: what it prints is what it does, and a Makefile or pkg-config comes to the same program."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.rccl.c.program import run_executable
from tests.support.c_programs import needs_compiler

HELLO = '#include "rccl.h"\nmain() { printf("%g\\n", rot(newtrans("T", varb), zunit, 90.)->n.y); return 7; }\n'
WIRE = '#include "qrobot_wire.h"\nint main(void) { return QROBOT_OK; }\n'

pytestmark = [needs_compiler, pytest.mark.usefixtures("own_cache")]


@pytest.fixture
def source(tmp_path: Path) -> Path:
    path = tmp_path / "hello.c"
    path.write_text(HELLO)
    return path


def cc(*arguments: object) -> int:
    return run_app(make_app("cc"), ["cc", *map(str, arguments)])


def printed(capfd: pytest.CaptureFixture[str], *options: object) -> list[str]:
    capfd.readouterr()
    assert cc(*options) == 0
    return shlex.split(capfd.readouterr().out)


def works(program: Path, capfd: pytest.CaptureFixture[str]) -> bool:
    return run_executable(program) == 7 and capfd.readouterr().out == "1\n"


def test_what_is_shown_is_what_would_be_done(source: Path, tmp_path: Path, capfd) -> None:
    shown = printed(capfd, "--show", source, "-O1", "-o", tmp_path / "hello")
    assert not (tmp_path / "hello").exists()
    subprocess.run(shown, check=True)
    assert works(tmp_path / "hello", capfd)


def test_a_makefile_compiles_and_links_with_what_is_printed_for_it(source: Path, tmp_path: Path, capfd) -> None:
    cflags, libs = printed(capfd, "--cflags"), printed(capfd, "--libs")
    assert printed(capfd, "--cflags", "--libs") == cflags + libs
    subprocess.run(["cc", *cflags, "-c", source, "-o", tmp_path / "hello.o"], check=True)
    subprocess.run(["cc", tmp_path / "hello.o", "-o", tmp_path / "hello", *libs], check=True)
    assert works(tmp_path / "hello", capfd)


def test_pkg_config_knows_the_same_options(source: Path, tmp_path: Path, capfd) -> None:
    cflags, libs = printed(capfd, "--cflags"), printed(capfd, "--libs")
    capfd.readouterr()
    assert cc("--pkg-config") == 0
    text = capfd.readouterr().out
    fields = dict(line.split(": ", 1) for line in text.splitlines())
    assert (shlex.split(fields["Cflags"]), shlex.split(fields["Libs"])) == (cflags, libs)
    assert fields["Version"]
    if not shutil.which("pkg-config"):
        return
    (tmp_path / "qrobot-rccl.pc").write_text(text)
    command = f"cc $(pkg-config --cflags qrobot-rccl) {source} -o {tmp_path}/hello $(pkg-config --libs qrobot-rccl)"
    subprocess.run(f'eval "{command}"', shell=True, check=True, env=os.environ | {"PKG_CONFIG_PATH": str(tmp_path)})
    assert works(tmp_path / "hello", capfd)


def test_compiling_alone_makes_no_library(source: Path, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "empty"))
    assert cc("-c", source, "-o", tmp_path / "hello.o") == 0
    assert not (tmp_path / "empty").exists()


def test_the_header_of_the_wire_client_is_found_too(tmp_path: Path) -> None:
    (tmp_path / "wire.c").write_text(WIRE)
    assert cc("-std=gnu99", "-c", tmp_path / "wire.c", "-o", tmp_path / "wire.o") == 0


def test_without_anything_to_compile_it_says_how_it_is_called(capfd) -> None:
    assert cc() == 1
    assert "nothing to compile: qrobot cc prog.c -o prog" in capfd.readouterr().err


def test_a_source_is_not_run_but_compiled_first(source: Path, capfd) -> None:
    assert run_app(make_app("run"), ["run", str(source)]) == 1
    assert f"`qrobot cc {source} -o hello`" in " ".join(capfd.readouterr().err.split())


@pytest.mark.parametrize(
    ("name", "advice"),
    [("cell.toml", "`qrobot run --deployment {} PROGRAM`"), ("palletise.v2", "`qrobot val run {}`")],
)
def test_a_file_of_another_kind_is_no_program(name: str, advice: str, tmp_path: Path, capfd) -> None:
    (tmp_path / name).touch()
    assert run_app(make_app("run"), ["run", str(tmp_path / name)]) == 1
    assert advice.format(tmp_path / name) in " ".join(capfd.readouterr().err.split())


def test_what_the_compiler_refuses_is_refused_in_its_words(tmp_path: Path, capfd) -> None:
    (tmp_path / "wrong.c").write_text("main() { this is no C }\n")
    assert cc(tmp_path / "wrong.c", "-o", tmp_path / "wrong") == 1
    assert "error:" in capfd.readouterr().err
