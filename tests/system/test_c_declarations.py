"""What programs of the time declare, define and hand over, as compilers of today see it."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from qrobot.cli import toolchain
from qrobot.rccl.c.program import run_executable
from tests.support.c_programs import CHECKED, EXAMPLES, compiled, compiled_text, needs_compiler, offline

pytestmark = [needs_compiler, pytest.mark.usefixtures("own_cache")]

HEADER = "".join((toolchain.INCLUDE / name).read_text() for name in ("rccl.h", "rccl_world.h"))
KINDS = """
    int hold;
    float varb;
    #define FRAME(t, k) t = newtrans("t", k)
    #define RIGID const
    int called;
    moves(t) TRSF_PTR t; { called++; }
    TRSF_PTR made(name, kind) char *name; int (*kind)(); { return newtrans(name, kind); }

    kind(t) TRSF_PTR t; { printf("%d%c ", t->kind, t->fn ? 'f' : '-'); }

    main()
    {
        int (*fn)() = moves;
        TRSF_PTR t;
        hold = 7;
        varb = hold / 2.;
        kind(newtrans("A", const)); kind(newtrans("A", varb)); kind(newtrans("A", hold));
        kind(newtrans("A", moves)); kind(newtrans("A", &moves)); kind(newtrans("A", (moves))); kind(newtrans("A", fn));
        kind(newtrans("A", hold ? fn : 0));
        FRAME(t, const); kind(t); FRAME(t, varb); kind(t); FRAME(t, hold); kind(t); FRAME(t, &moves); kind(t);
        FRAME(t, RIGID); kind(t);
        kind(made("A", rccl_const)); kind(made("A", rccl_varb)); kind(made("A", rccl_hold)); kind(made("A", moves));
        printf("%d %g %s\\n", hold, varb, t->name);
        return 0;
    }
"""
DECLARED = """
    #include <stdlib.h>
    main()
    {
        TRSF_PTR newtrans(), gentr_trsl(), rot();
        POS_PTR makeposition(), jposition();
        int control(), release(), setmode(), setmod(), move(), setvel(), setval(), setime(), evalfn();
        int distance(), limit(), comply(), lock(), update();
        int stop(), sample(), setconf(), suspendfg(), teach(), freetrans(), makedb();
        TRSF_PTR e = gentr_trsl("E", 0., 0., 100.), a = newtrans("A", const);
        POS_PTR p = makeposition("P", t6, e, EQ, a, TL, e);
        control(); release(); control(suspendfg); release("said");
        exit(p->end);
    }
"""
MODERN = """
    static int moves(TRSF_PTR t) { t->p.x = how.time; return 0; }
    static int watch(void) { nextmove = how.time > 1e6; return 0; }

    int main(void)
    {
        TRSF_PTR e = gentr_trsl("E", 0, 0, 100), m = newtrans("M", &moves), c = newtrans("C", const);
        POS_PTR p = makeposition("P", t6, e, EQ, c, m, TL, e), q = jposition("Q", 0, -90, 180, 0, 0, 0);
        TRSF_PTR h = newtrans("H", hold), v = newtrans("V", varb);

        control(watch, watch);
        setmode('c');
        setmode("joint");
        setvel(200, 90);
        setime(0, 400);
        evalfn(watch);
        distance("dz rx", -10, 5);
        limit("fz", 15);
        update(h, p);
        move(q);
        waitfor(completed)
        waitas(q->scal > .5)
        OPEN
        CLOSE
        Trmult(v, h, c);
        Rot(v, zunit, 30);
        printr(v, stdout);
        release("done", NULL);
        return 0;
    }
"""


def test_kinds_are_handed_over_as_a_c_programmer_writes_them(tmp_path: Path, capfd) -> None:
    """The words in a macro of the program's own too, a function as such, by `&`, in parentheses, by a pointer."""
    program = compiled_text(KINDS, tmp_path, *CHECKED)
    assert run_executable(program) == 0
    const, varb, hold, fn = "1-", "2-", "3-", "0f"
    kinds = [const, varb, hold, *[fn] * 5, const, varb, hold, fn, const, const, varb, hold, fn]
    assert capfd.readouterr().out == f"{' '.join(kinds)} 7 3.5 t\n"


def test_functions_of_the_library_may_be_declared_as_of_old(tmp_path: Path, capfd) -> None:
    assert offline(lambda: run_executable(compiled_text(DECLARED, tmp_path)))[0] == 0
    assert capfd.readouterr().out == "said\n"


def test_every_function_of_the_header_may_be_declared_once_more_without_arguments(tmp_path: Path) -> None:
    """`int move();` as careful programs did, and lint asked for."""
    declared = re.findall(r"^((?:int|TRSF_PTR|POS_PTR)) (\w+)\(", HEADER, re.MULTILINE)
    names = {name: returns for returns, name in declared if not name.startswith("rccl_")}
    assert {"newtrans", "makeposition", "control", "distance", "setmode", "waitas"} - set(names) == {"waitas"}
    text = "".join(f"{returns} {name}();\n" for name, returns in names.items())
    compiled_text(f"{text}main() {{ {text} }}", tmp_path, "-c")


@pytest.mark.parametrize("flags", [("-Wall",), ("-Wall", "-Wextra", "-O2"), ("-Wall", "-std=gnu11")])
def test_a_compiler_that_may_speak_has_nothing_to_say_about_the_header(flags, tmp_path: Path) -> None:
    source = tmp_path / "modern.c"
    source.write_text(f'#include "rccl.h"\n{MODERN}')
    command = toolchain.command_line([*flags, "-c", str(source), "-o", str(tmp_path / "modern.o")])
    said = subprocess.run(command, capture_output=True, text=True, check=True).stderr
    assert said == ""


def test_of_the_papers_programs_the_compiler_only_says_that_they_are_old(tmp_path: Path) -> None:
    for source in sorted((EXAMPLES / "c").glob("s0*.c")):
        command = toolchain.command_line(["-Wall", "-c", str(source), "-o", str(tmp_path / "x.o")])
        said = subprocess.run(command, capture_output=True, text=True, check=True).stderr
        assert set(re.findall(r"\[(-W[\w-]+)\]", said)) <= {"-Wimplicit-int", "-Wreturn-type"}, said


def test_the_real_board_and_wire_headers_still_come_along(tmp_path: Path) -> None:
    source = tmp_path / "wire.c"
    source.write_text('#include "qrobot_wire.h"\nint main(void) { return QROBOT_OK; }\n')
    assert compiled(source, tmp_path).exists()
