"""Programs in C of Multi-RCCL: several manipulators, each the first argument of its calls."""

from __future__ import annotations

import re
import runpy
import subprocess
from pathlib import Path

import numpy as np
import pytest

from qrobot.arrays import Floats
from qrobot.c_transport.program import run_served
from qrobot.cli import toolchain
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.multi_rccl.c.__main__ import other_release
from qrobot.multi_rccl.c.dispatcher import ManipDispatcher
from qrobot.multi_rccl.program import _program
from qrobot.rccl.program import ending
from qrobot.rccl.trace import Trace
from tests.support.c_programs import (
    CHECKED,
    EXAMPLES,
    compiled,
    compiled_text,
    edited_for_manipulators,
    keyboard,
    needs_compiler,
    offline,
    way_of_c,
)

pytestmark = [needs_compiler, pytest.mark.usefixtures("own_cache")]
SENSED = 0.002  # rad: by which a sensor that looks one sample earlier moves the joints of an arm at a wavy table
ROUNDING = 2e-6  # rad: fields of C programs are single precision

TWO_ARMS = """
MANIP *left, *right, *obj;
TRSF *tool, *place;

begin()
{
    left = rccl_open("left");
    right = rccl_open("right", "puma560");
    rccl_control(left);
    rccl_control(right);
    tool = gentr_trsl("TOOL", 0., 0., 150.);
    place = gentr_rpy("PLACE", 500., 0., 0., 0., 180., 0.);
}

check(what, well) char *what;
{
    if (!well) {
        printf("WRONG: %s\\n", what);
        exit(3);
    }
}
"""

MODERN = """
#include <rccl.h>

int main(void)
{
    MANIP *left = rccl_open("left", "puma560"), *obj = rccl_open("OBJECT_FRAME");
    POS *p = makePosition(TRANS, EQ, &obj->trans, TL, TRANS), *q = jposition(left, "Q", 0, -45, 180, 0, 45, 0);
    rccl_control(left);
    rccl_control(obj, 28);
    setmode(left, 'c');
    distance(left, "dx dy", 10, 20.5);
    move(left, p);
    stop(left);
    stop(left, q);
    stop(left, NULL, 100);
    GRASP(left);
    wait_for(left->completed);
    waitas(left->trans.p.x > 100);
    rccl_release(left);
    return p->code;
}
"""


def run(program: Path, *arguments: str) -> tuple[int, list[Trace]]:
    """Exit status of a program that is run off line, and what it has done with each arm it took."""
    languages = [other_release, other_release, ManipDispatcher]
    status, traces = offline(lambda: run_served(program, arguments, languages))
    assert isinstance(status, int)
    return status, traces


def ways(traces: list[Trace]) -> list[Floats]:
    """Setpoints of each arm, rad. Shapes (samples, n)."""
    return [trace.setpoints.q for trace in traces]


def twin(example: str = "22_two_hands.py") -> list[Floats]:
    """Those of the example in Python."""
    token = _program.set(None)

    def start() -> None:
        with ending():
            runpy.run_path(str(EXAMPLES / example), run_name="__main__")

    _, traces = offline(start)
    _program.reset(token)
    return ways(traces)


def test_under_sanitizers_two_hands_are_sent_where_those_of_their_twin_are_c22(tmp_path: Path, capfd) -> None:
    status, traces = run(compiled(EXAMPLES / "c" / "two_hands.c", tmp_path, *CHECKED))
    assert status == 0
    assert re.match(r"both hands hold the object at x = 48\d\.\d mm\ncarried along one path", capfd.readouterr().out)
    for in_c, in_python in zip(ways(traces), twin(), strict=True):
        assert in_c.shape == in_python.shape
        assert np.abs(in_c - in_python).max() < ROUNDING


def test_one_equation_leads_to_four_places_as_in_python_s09(tmp_path: Path, capfd) -> None:
    status, traces = run(compiled(EXAMPLES / "c" / "four_places.c", tmp_path, *CHECKED))
    assert status == 0
    in_c = capfd.readouterr().out
    (of_c,), (of_python,) = ways(traces), twin("18_four_places.py")
    assert capfd.readouterr().out == in_c
    assert np.abs(of_c - of_python).max() < ROUNDING
    near = [re.findall(r"-?\d+\.\d", line) for line in in_c.splitlines()]
    for (x, y), (px, py) in zip(near, ((0, -60), (80, -60), (80, 60), (0, 60)), strict=True):
        assert np.hypot(float(x) - 480, float(y) - 60) == pytest.approx(np.hypot(px, py), abs=15)  # passed, and turned


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "arms", "twin_name"),
    [("two_hands", ["--deployment", "two_arms"], None), ("four_places", [], "18_four_places.py")],
    ids=["s08", "s09"],
)
def test_examples_in_c_do_through_servos_what_they_do_with_ideal_arms(
    name: str, arms: list[str], twin_name: str | None, tmp_path: Path, capfd
) -> None:
    def through_servos(program: Path) -> str:
        assert run_app(make_app("run"), ["run", "--lockstep", *arms, str(program)]) == 0
        return capfd.readouterr().out

    program = compiled(EXAMPLES / "c" / f"{name}.c", tmp_path)
    status, _ = run(program)
    ideal = capfd.readouterr().out
    assert status == 0
    assert [round(float(x)) for x in re.findall(r"-?\d+\.\d", ideal)] == pytest.approx(
        [float(x) for x in re.findall(r"-?\d+\.\d", through_servos(program))], abs=2.0
    )
    if twin_name is not None:
        assert through_servos(EXAMPLES / twin_name) == through_servos(program)


EDITED = [
    "s01_four_corners", "s02_grasp", "s03_data_base", "s04_stop_on_keyboard", "s05_follow_a_surface", "s07_stack_blocks"
]  # fmt: skip


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", EDITED)
def test_a_program_of_one_arm_runs_with_small_edits_and_sends_the_same_setpoints(
    name: str, tmp_path: Path, capfd
) -> None:
    source = tmp_path / "edited.c"
    source.write_text(edited_for_manipulators(EXAMPLES / "c" / f"{name}.c"))
    with keyboard("\n"):
        status, traces = run(compiled(source, tmp_path))
    assert status == 0
    said = without_times(capfd.readouterr())
    with keyboard("\n"):
        before = under_way(way_of_c(compiled(EXAMPLES / "c" / f"{name}.c", tmp_path)))
    assert without_times(capfd.readouterr()) == said
    (edited,) = map(under_way, ways(traces))
    if name == "s05_follow_a_surface":  # its sensor looks from where the arm is sent: here is no measured T6
        shorter = min(len(edited), len(before))
        assert abs(len(edited) - len(before)) <= 1
        assert np.abs(edited[:shorter] - before[:shorter]).max() < SENSED
    else:
        assert edited.shape == before.shape
        assert np.array_equal(edited, before)


def without_times(said: tuple[str, str]) -> str:
    """What a program has printed: the other release has no clock of the program's."""
    return re.sub(r"\d+ ms", "ms", "".join(said))


def under_way(q: Floats) -> Floats:
    """Setpoints from the first that moves to the last, if any does. Shape (samples, n)."""
    moving = np.flatnonzero(np.abs(np.diff(q, axis=0)).max(axis=1))
    return q[moving[0] : moving[-1] + 2] if moving.size else q[:0]


def test_every_call_does_what_it_says(tmp_path: Path, capfd) -> None:
    text = (
        TWO_ARMS
        + r"""
int samples = 0, ended = 0;
count() { samples++; }
end_it() { if (++ended == 20) left->nextmove = 7; }

main()
{
    POS *p, *q, *mine, *j;
    TRSF *copy = newtrans("COPY", rccl_varb);
    begin();
    check("joints", left->n == 6 && right->n == 6 && left->mode == 5 && (left->flags & 1));
    check("names", !strcmp(left->name, "left") && !strcmp(left->trans.name, "left"));
    p = makePosition(TRANS, tool, EQ, place, TL, tool);
    mine = makePositionFor(&left->trans, &left->trans, EQ, place, TL, &left->trans);
    check("a name", p->name[0] == 'P');

    setmode(left, 'j'); setvel(left, 300., 90.); evalfn(left, count);
    move(left, p);
    check("queued", left->nbrequest == 1 && !left->completed && right->completed);
    stop(left, p, 400.);
    waitfor(left->completed)
    check("there", p->code == -1 && p->scal == 1 && samples > 5 && left->nbrequest == 0);
    check("where it is", fabs(left->trans.p.x - 500) < 0.01 && fabs(left->trans.p.z - 150) < 0.01);
    Assigntr(copy, &left->trans);
    check("copied", copy->p.x == left->trans.p.x);
    check("multiplied", fabs(trmult(copy, &left->trans, tool)->p.z) < 0.01);

    j = jposition(right, "J", 0, -45, 180, 10, 45, 20);
    move(right, j);
    wait_for(j->end);
    check("degrees", fabs(right->j6[1] + 45) < 1e-3 && fabs(right->j6[3] - 10) < 1e-3);
    move(right, rccl_pose(right, "park"));
    stop(right);
    wait_for(right->completed);

    q = makePosition(TRANS, EQ, gentr_rpy("Q", 400., 100., 200., 0., 180., 0.), TL, TRANS);
    setmod(left, "cartesian"); setval(left, 100., 30.); setime(left, 100., 1500.);
    distance(left, "dz", -20); evalfn(left, end_it);
    move(left, q);
    waitas(q->code)
    check("ended by nextmove", q->code == 7);
    stop(left, NULL, 300.);
    waitfor(left->completed)
    check("stays where it was ended", hypot(left->trans.p.x - 400, left->trans.p.y - 100) > 50);
    move(left, mine); move(left, there);
    rccl_cancel(left, 0.);
    waitfor(left->completed)

    GRASP(left);
    left->outputs = 1;
    rccl_manip_sample();
    OPEN(left);
    setconf(left, "lun");
    trsl(copy, 0., 0., 0.);
    update(left, copy, makePosition(TRANS, EQ, copy, TL, TRANS));
    move(left, makePosition(TRANS, EQ, place, gentr_trsl("UP", 0., 0., -170.), TL, TRANS));
    rccl_pause(left);
    move(right, j);
    waitfor(right->completed)
    check("paused, while the other goes", !left->completed);
    rccl_resume(left);
    rccl_override(left, 50.);
    waitfor(left->completed)
    rccl_override(left, 100.);
    check("updated", fabs(copy->p.z - left->trans.p.z) < 0.01 && fabs(copy->p.x - 500) < 0.01);
    rccl_setload(left, 1., NULL, NULL);
    rccl_keep_path(left, YES, 300., 45.);
    rccl_retract(left, 20.);
    check("kept nothing", rccl_kept(left)[0] == 0);
    rccl_resume(left);

    obj = rccl_open("OBJECT_FRAME");
    rccl_control(obj);
    maintain(obj, makePosition(TRANS, EQ, place, TL, TRANS));
    rccl_manip_sample();
    check("a frame is put", obj->n == 0 && fabs(obj->trans.p.x - 500) < 1e-3 && obj->completed);
    setvel(obj, 100., 30.);
    move(obj, makePosition(TRANS, EQ, tool, TL, TRANS));
    trackingMode(obj);
    obj->nextmove = 3;
    waitfor(obj->completed)
    rccl_release(right);
    rccl_release(obj);
    freepos(q);
    printf("all calls made\n");
    return 5;
}
"""
    )
    includes = "#include <math.h>\n#include <stdlib.h>\n#include <string.h>\n"
    status, traces = run(compiled_text(includes + text, tmp_path, *CHECKED))
    assert capfd.readouterr().out == "all calls made\n"
    assert status == 5
    left, right = traces
    assert left.requests[0].code == -1
    assert right.requests[0].mode == "joint"


MISTAKES = {
    "a null pointer": ("move(NULL, there)", "move: a manipulator, from rccl_open, is needed, and a null pointer"),
    "no manipulator": ("MANIP m; move(&m, there)", "move: this is no manipulator of rccl_open"),
    "no position": ("POS p; begin(); move(left, &p)", "move: this is no position of makeposition or jposition"),
    "a null position": ("begin(); move(left, NULL)", "move: a position is needed, and a null pointer was given"),
    "not taken": ('left = rccl_open("left"); move(left, there)', "left is not under control; call rccl_control first"),
    "a line break": ('rccl_open("left\\nstanford")', "rccl_open: a name, a robot or a bridge has a line break in it"),
    "twice": ('rccl_open("left"); rccl_open("left")', "rccl_open: left is open already"),
    "no robot": ('rccl_open("left", "r2d2")', "r2d2"),
    "no bridge": ('rccl_open("left", "puma560", "nowhere:at all")', "nowhere:at all"),
    "no equation": ("begin(); makePosition(tool, EQ, place, TL)", "makePosition: write (terms with TRANS, EQ, terms,"),
    "no transform": ("makePosition(TRANS, EQ, tool, TL, TRANS)", "makePosition: write (terms with"),
    "another's": (
        "begin(); move(left, makePositionFor(&right->trans, &right->trans, EQ, place, TL, &right->trans))",
        "is solved for right.trans: it is no goal of left",
    ),
    "EQ is no unknown": ("begin(); makePositionFor(EQ, TRANS, EQ, place, TL, TRANS)", "the unknown is a transform"),
    "where it is": ("begin(); trsl(&left->trans, 1., 2., 3.)", "left.trans is where left is: move it, or copy"),
    "joints of a frame": ('obj = rccl_open("OBJECT_FRAME"); rccl_control(obj); setconf(obj, "lun")', "has no joints"),
    "a frame's hand": ('obj = rccl_open("OBJECT_FRAME"); GRASP(obj)', "OBJECT_FRAME is an object frame; an arm is"),
    "a frame's update": (
        'obj = rccl_open("OBJECT_FRAME"); rccl_control(obj); update(obj, newtrans("T", const), there)',
        "is an object frame; an arm is",
    ),
    "update of what is not in it": ("begin(); update(left, tool, makePosition(TRANS, EQ, place, TL, TRANS))", "TOOL"),
    "update by another's": (
        "begin(); update(left, place, makePositionFor(&right->trans, &right->trans, EQ, place, TL, &right->trans))",
        "is solved for right.trans: it is no goal of left",
    ),
    "no reaction": ('begin(); rccl_collision(left, "dance", 0., NULL)', "dance"),
    "too far back": ("begin(); rccl_retract(left, 400.)", "retract(400): 0 to 300 mm are possible"),
    "a frame's way back": (
        'obj = rccl_open("OBJECT_FRAME"); rccl_control(obj); rccl_retract(obj, 20.)',
        "retract: OBJECT_FRAME is an object frame; an arm is",
    ),
    "too fast": ("begin(); rccl_override(left, 200.)", "0 to 100 per cent are possible"),
    "no arm": ('obj = rccl_open("OBJECT_FRAME"); rccl_control(obj); rccl_manip_sample()', "no arm is under control"),
    "no motion": ('begin(); POS *p = rccl_pose(left, "park"); wait_for(p->end)', "no motion is left that could signal"),
    "too far": ('begin(); move(left, makePosition(TRANS, EQ, gentr_trsl("FAR", 5000., 0., 0.), TL, TRANS))', "reach"),
    "another period": ('left = rccl_open("left"); rccl_control(left, 0.2)', "0.2"),
    "terminate": ("begin(); terminate = 1; rccl_manip_sample()", "the program has set `terminate`"),
}


@pytest.fixture(scope="module")
def mistaken(own_cache: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A program that makes the mistake it is told."""
    cases = "\n".join(f"case {i}: {{ {text}; break; }}" for i, (text, _) in enumerate(MISTAKES.values()))
    text = f"#include <stdlib.h>\n{TWO_ARMS}\nmain(argc, argv) char **argv;\n{{ switch (atoi(argv[1])) {{ {cases} }} }}"
    return compiled_text(text, tmp_path_factory.mktemp("c"))


@pytest.mark.sampled(14)
@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_told_in_a_line_and_ends_the_program(mistaken: Path, mistake: str, capfd) -> None:
    status, _ = run(mistaken, str(list(MISTAKES).index(mistake)))
    said = capfd.readouterr().err
    assert status == 1
    assert MISTAKES[mistake][1] in said
    assert "Traceback" not in said


def test_a_person_shows_a_transform_with_one_of_the_arms(tmp_path: Path, capfd) -> None:
    text = (
        TWO_ARMS
        + r"""
    main()
    {
        TRSF *corner = gentr_trsl("CORNER", 0., 0., 0.);
        begin();
        check("shown", teach(left, corner, makePosition(TRANS, EQ, corner, TL, TRANS)) == YES);
        check("where the arm is", fabs(corner->p.z - left->trans.p.z) < 0.01 && corner->p.z < 0);
    }"""
    )
    program = compiled_text(f"#include <math.h>\n#include <stdlib.h>\n{text}", tmp_path)
    with keyboard("world dz -20\nrecord\nq\n"):
        status, (left, right) = run(program)
    assert status == 0
    assert "recorded CORNER" in capfd.readouterr().out
    assert np.ptp(left.setpoints.q, axis=0).max() > 0.0 == np.ptp(right.setpoints.q, axis=0).max()


def test_a_program_ends_with_its_motions_done_and_its_arms_let_go_of(tmp_path: Path, capfd) -> None:
    text = TWO_ARMS + "main() { begin(); move(left, makePosition(TRANS, tool, EQ, place, TL, tool)); }"
    status, (left, right) = run(compiled_text(text, tmp_path))
    assert (status, capfd.readouterr().err) == (0, "")
    assert left.requests[0].code == -1
    assert right.requests == []


@pytest.mark.parametrize("end", ["exit(3);", "terminate = 1; rccl_manip_sample();", "move(left, 0);", "abort();"])
def test_a_program_that_ends_badly_has_all_its_arms_stopped_at_one_sample(end: str, tmp_path: Path, capfd) -> None:
    text = f"""
    main()
    {{
        POS *p, *q;
        begin();
        p = jposition(left, "P", 40., -45., 180., 0., 45., 0.);
        q = jposition(right, "Q", 40., -45., 180., 0., 45., 0.);
        setime(left, 100., 4000.); setime(right, 100., 4000.);
        move(left, p); move(right, q);
        waitas(p->scal > .3)
        {end}
    }}"""
    status, (left, right) = run(compiled_text(f"#include <stdlib.h>\n{TWO_ARMS}{text}", tmp_path))
    assert status != 0
    ways = [under_way(trace.setpoints.q) for trace in (left, right)]
    assert 0 < len(ways[0]) < 4000 / 28 + 2
    assert np.array_equal(*ways)


def test_the_sources_tell_which_release_they_want(tmp_path: Path) -> None:
    def includes(text: str, release: toolchain.Release = "auto") -> bool:
        source = tmp_path / "program.c"
        source.write_text(text)
        flags = toolchain.compile_flags(["-O2", str(source), "-o", "program"], release)
        return f"-I{toolchain.MULTI_INCLUDE}" in flags

    assert includes("static MANIP_PTR arm;")
    assert includes("main() { p = makePosition(TRANS, EQ, q, TL, TRANS); }")
    assert not includes('/* not rccl_open */ main() { puts("MANIP"); move(park); // trackingMode\n}')
    assert includes("int n;", "multi")
    assert not includes("MANIP *m;", "1.0")


def test_a_compiler_that_may_speak_has_nothing_to_say_about_the_header(tmp_path: Path) -> None:
    source = tmp_path / "modern.c"
    source.write_text(MODERN)
    command = toolchain.command_line(["-Wall", "-Wextra", "-O2", "-c", str(source), "-o", str(tmp_path / "modern.o")])
    assert subprocess.run(command, capture_output=True, text=True, check=True).stderr == ""


def test_files_of_two_releases_make_no_program_that_moves(tmp_path: Path, capfd) -> None:
    old, new = tmp_path / "old.c", tmp_path / "new.c"
    old.write_text("#include <rccl.h>\nold_way() { move(there); }\n")
    new.write_text('#include <rccl.h>\nmain() { rccl_control(rccl_open("left")); old_way(); }\n')
    for source in (old, new):
        subprocess.run(toolchain.command_line(["-c", str(source), "-o", str(source.with_suffix(".o"))]), check=True)
    target = tmp_path / "both"
    objects = [str(source.with_suffix(".o")) for source in (old, new)]
    subprocess.run(toolchain.command_line([*objects, "-o", str(target)]), check=True)
    status, (trace,) = run(target)
    assert status == 1
    assert "this is a call of RCCL 1.0 in a program of Multi-RCCL: compile all files" in capfd.readouterr().err
    assert trace.requests == []


def test_functions_of_old_sources_may_be_declared(tmp_path: Path) -> None:
    text = """
MANIP_PTR rccl_open(); POS_PTR makePosition(), jposition(); int stop(), move(), setmode(), rccl_control(), distance();
main() { MANIP *m = rccl_open("left"); rccl_control(m, 14.); return m->n; }
"""
    status, (trace,) = run(compiled_text(text, tmp_path))
    assert status == 6
    assert trace.setpoints.period_us == 14_000
