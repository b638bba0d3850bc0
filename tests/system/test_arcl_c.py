"""Programs in C that include `<arcl.h>`: beside their twins in Python, and what they are told of wrong input."""

from __future__ import annotations

import re
import subprocess
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from qrobot import arcl, rci
from qrobot.arcl.attributes import Attribute
from qrobot.arcl.c.calls import CALLS
from qrobot.arcl.events import ArclEvent, Grip
from qrobot.arcl.kinematics import kinematics
from qrobot.arcl.stream import RecordKind, read_stream
from qrobot.cli import toolchain
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.cli.teach_pendant import teach_by_keys
from qrobot.faultcodes import FaultCode
from qrobot.rci import VirtualLink
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.wire import Hello
from tests.support.arcl import EXAMPLES, keys_of_a_terminal, run_c, run_example
from tests.support.c_programs import (
    CHECKED,
    FOUND,
    compiled,
    needs_compiler,
    needs_cpp_compiler,
    needs_valgrind,
    under_valgrind,
)
from tests.support.fake_robot import FakeRobot
from tests.support.puma import PARK, ROBOT

pytestmark = [needs_compiler, pytest.mark.usefixtures("own_cache", "arcl_alone")]
HEADER = (toolchain.ARCL_INCLUDE / "arcl.h").read_text()
PAGE = (Path(__file__).parents[2] / "docs/reference/arcl-c.md").read_text()
STREAMS = {
    "s11_first_program": ["puma560.arcl"],
    "s12_weave": ["puma560.arcl"],
    "s13_two_arms": ["puma560.arcl", "puma560-2.arcl"],
    "s14_figure_5": ["puma560.arcl"],
}
CPP11, CPP20 = (pytest.param(f"c++ -std={each}", marks=needs_cpp_compiler) for each in ("c++11", "c++20"))
SAME = 1e-12  # rad; numbers of C are double too, and millimetres there and back are an ulp


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", STREAMS)
def test_a_program_in_c_gives_the_stream_and_the_traces_of_its_twin_sample_by_sample(
    name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    switches = ["+m", "+tr", "+nolim"] if name == "s14_figure_5" else ["+m", "+tr"]
    program = compiled(EXAMPLES / f"{name}.c", tmp_path, "-O1", "-g", *CHECKED[2:])
    assert run_c(program, tmp_path / "c", *switches) == 0
    in_c = capfd.readouterr().out
    run_example(f"{name}.py", tmp_path / "python", *switches)
    in_python = capfd.readouterr().out
    traced = r"(?m)^(?:request|exec|\w+ : |ami_offl|T6 at| *[\d.]+ s: arm).*"
    assert re.findall(traced, in_c) == re.findall(traced, in_python)
    for file in STREAMS[name]:
        one, other = (read_stream(tmp_path / folder / file) for folder in ("c", "python"))
        (times, joints), (twin_times, twin_joints) = (stream.table(RecordKind.JOINTS, 6) for stream in (one, other))
        assert len(times) > 60
        assert np.array_equal(times, twin_times)
        assert np.abs(joints - twin_joints).max() < SAME


@needs_valgrind
def test_every_call_gives_what_it_should_and_valgrind_finds_nothing(tmp_path: Path, capfd) -> None:
    program = compiled(Path(__file__).parent / "arcl_all_calls.c", tmp_path, "-gdwarf-4", "-lm")
    assert run_c(under_valgrind(program), tmp_path, "+nolim", str(tmp_path / "table"), "word") == 0, FOUND
    said = capfd.readouterr().out
    assert "WRONG" not in said
    assert said.count("as it should be") == 21
    assert said.endswith("all calls made\n")


KEPT = """\
#include <arcl.h>
#include <stdio.h>
#include <string.h>
static ROBOT *rp;
static int stopped(void) { return *arcl_kept(rp); }
int main(void)
{
    rp = arcl_open(0);
    arcl_keep_path(rp, 1, 5., 45.);
    arcl_override(rp, 90.);
    Motion *m = move(rp, joint_pos(rp, "P", 40., 90., -90., 0., 90., 0.), MOV_TIME, 2000, 0);
    arcl_wait(rp, stopped);
    printf("%s, code %d\\n", strstr(arcl_kept(rp), "FOLLOWING") ? "FOLLOWING" : arcl_kept(rp), m->code);
    arcl_resume(rp);
    arcl_wait(rp, stopped);
    printf("%s\\n", strstr(arcl_kept(rp), "too long") ? "too long" : arcl_kept(rp));
    arcl_keep_path(rp, 1, 300., 45.);
    arcl_resume(rp);
    arcl_wait(rp);
    printf("code %d, kept '%s'\\n", m->code, arcl_kept(rp));
    arcl_keep_path(rp, 1, -1., 45.);
    return 0;
}
"""


def test_a_program_that_keeps_its_path_sees_why_it_waits_and_goes_on_when_it_confirms(tmp_path: Path, capfd) -> None:
    (tmp_path / "kept.c").write_text(KEPT)
    fake = FakeRobot(tuple(PARK))

    def stop_it(seq: int) -> None:
        if fake.q[0] > np.radians(20.0):
            fake.before_period = None
            fake.break_down(FaultCode.FOLLOWING)
            fake.q = tuple(np.array(fake.q) + 0.02)

    fake.before_period = stop_it
    with rci.use(lambda hello: VirtualLink(hello, fake.transfer)):
        assert run_c(compiled(tmp_path / "kept.c", tmp_path), tmp_path, ami="bridge") == 1
    told = capfd.readouterr()
    assert told.out == "FOLLOWING, code 0\ntoo long\ncode 4, kept ''\n"
    assert "keep_path: a way back of 0 or more mm and degrees is needed, not -1.0" in told.err
    assert fake.q[0] == pytest.approx(np.radians(40.0))


def test_a_program_in_c_tells_two_arms_apart_by_their_bridges_s13(tmp_path: Path, capfd) -> None:
    places = ("127.0.0.1:5600", "127.0.0.1:5601")
    fakes = [FakeRobot(tuple(PARK)) for _ in places]

    def link(fake: FakeRobot, hello: Hello) -> VirtualLink:
        return VirtualLink(hello, fake.transfer)

    with rci.use({place: partial(link, fake) for place, fake in zip(places, fakes, strict=True)}):
        assert run_c(compiled(EXAMPLES / "s13_two_arms.c", tmp_path), tmp_path, *places, ami="bridge") == 0
    said = re.findall(r"arm (\d) (enters|is done)", capfd.readouterr().out)
    assert sorted(said) == [("1", "enters"), ("1", "is done"), ("2", "enters"), ("2", "is done")]
    assert [event for _, event in said] == ["enters", "is done", "enters", "is done"]
    assert [fake.q for fake in fakes] == [pytest.approx(PARK), pytest.approx(PARK)]


WRONG = """\
#include <arcl.h>
#include <string.h>
int main(int argc, char **argv)
{
    ROBOT *rp = arcl_open(ARCL_AMI, "offline", 0);
    Trans mine, *t = new_trans_tr("t", 500, 0, 0);
    Pos *p = makeposition(T6, EQ, t, TL, t);
    char text[400];
    int given = argc > 1 ? argv[1][0] - 'a' : -1;
    memset(text, 'x', sizeof text);
    text[399] = 0;
    memset(&mine, 0, sizeof mine);
    switch (given) {
    case 0: move(NULL, p, 0); break;
    case 1: move(rp, 0); break;
    case 2: move(rp, p, 4711, 1, 0); break;
    case 3: move(rp, p, MOV_TIME); break;
    case 4: move(rp, p, MOV_TIME, "soon", 0); break;
    case 5: move(rp, p, MOV_CONFIG, 17, 0); break;
    case 6: move(rp, p, MOV_NOTIFY, NULL, 0); break;
    case 7: move(rp, p, MOV_OFFSET, &mine, 0); break;
    case 8: new_trans_rotvec("r", 0, 0, 0, NULL, 30); break;
    case 9: new_trans_tr(text, 0, 0, 0); break;
    case 10: makeposition(T6, t, TL, t); break;
    case 11: arcl_free(t); trans_assign(t, t); break;
    case 12: quat_mult(NULL, NULL); break;
    case 13: sem_take((Semaphore *) rp); break;
    case 14: joint_pos(rp, "j", 1, 2, 3); break;
    case 15: move(rp, p, MOV_TIME, &given, 0); break;
    case 16: gripper(rp, GRIP_CLOSE_BY, 0 - 1.0); break;
    case 17: new_trans("t", FNDEF); break;
    case 18: sym_load(NULL); break;
    case 19: new_trans_tr("n", 0.0 / 0.0, 0, 0); break;
    case 20: return arcl_open(ARCL_ROBOT, "nobody", 0) ? 0 : 7;
    case 21: diff_in(t, NULL); break;
    case 22: move(); break;
    case 23: named_iod(rp, "presure"); break;
    case 24: iod_read(named_iod(rp, "pressure")); break;
    case 26: new_trans_tr("a\\037b", 0, 0, 0); break;
    case 25: arcl_free(move(rp, p, 0)); break;
    }
    return 0;
}
"""
TOLD = {
    "a": "move: a robot is needed, from arcl_open, not None",
    "b": "move: a position is needed, from makeposition or joint_pos, not 0",
    "c": "move: 4711 is no attribute",
    "d": "move: MOV_TIME needs 1 value behind it",
    "e": "MOV_TIME: a finite number from 0 on is needed, not 'soon'",
    "f": "configuration",
    "g": "MOV_NOTIFY: a function is needed, not None",
    "h": "move: a pointer leads to no object that ARCL has made",
    "i": "new_trans_rotvec: a null pointer was given",
    "j": "new_trans_tr: longer texts",
    "k": "makeposition pos: write",
    "l": "trans_assign: a pointer leads to no object that ARCL has made, or to one that was freed",
    "m": "quat_mult: a null pointer",
    "n": "sem_take: a semaphore is needed",
    "o": "6 finite joint positions are needed",
    "p": "MOV_TIME: a finite number from 0 on is needed, not something of another type",
    "q": "GRIP_CLOSE_BY needs millimetres from 0 on",
    "r": "a function belongs to a functional transform",
    "s": "sym_load: a null pointer",
    "t": "transform n: a vector of three finite numbers is needed",
    "u": "nobody",
    "v": "diff_in: a null pointer",
    "w": "move: 0 values; from 2",
    "x": "puma560 has no signal 'presure'; it has lamps, power, pressure",
    "y": "pressure is an analogue channel, in bar: iod_value reads it",
    "{": "a text has the character 31 in it",
    "z": "arcl_free: the memory of a motion stays ARCL's",
}


@pytest.fixture(scope="module")
def wrong(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wrong")
    (folder / "wrong.c").write_text(WRONG)
    return compiled(folder / "wrong.c", folder, *CHECKED)


@pytest.mark.sampled(14)
@pytest.mark.parametrize("mistake", TOLD)
def test_wrong_input_ends_the_program_with_what_is_wrong(mistake: str, wrong: Path, tmp_path: Path, capfd) -> None:
    assert run_c(wrong, tmp_path, mistake) == (7 if mistake == "u" else 1)
    assert TOLD[mistake] in capfd.readouterr().err


TAUGHT = """\
#include <arcl.h>
#include <stdio.h>
static int learn(Trans *t6, ROBOT *rp)
{
    static int count;
    Trans *place = new_trans(count++ ? "second" : "first", VARB);
    sym_enter(trans_assign(place, t6));
    printf("%s: %.1f %.1f %.1f\\n", rp->name, t6->t_p.x, t6->t_p.y, t6->t_p.z);
    return count == 2 ? MOVE_STOP : OK;
}
int main(int argc, char **argv)
{
    ROBOT *rp = arcl_open(ARCL_ARGCV, argc, argv, 0);
    printf("%d presses\\n", teach(rp, learn));
    printf("kept: %.1f\\n", sym_lookup("second")->t_p.x);
    arcl_close(rp);
    return teach(rp, NULL);
}
"""


def test_a_program_in_c_is_taught_by_the_pendant(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "taught.c").write_text(TAUGHT)
    program = compiled(tmp_path / "taught.c", tmp_path)
    keys = keys_of_a_terminal((0.0, "\n"), (300.0, "x"), (600.0, "\n"))
    pendant = partial(teach_by_keys, read_keys=keys, tell=lambda _: None)
    rig = LockstepRig(ROBOT, ServoSettings(rate_hz=500.0), Emulator(ROBOT, physics="rigid"))
    with rci.use(partial(link_factory, rig, 28_000)):
        assert run_c(program, tmp_path, ami="bridge", pendant=pendant) == 1
    said = capfd.readouterr()
    aki = kinematics(ROBOT)
    x, y, z = 1e3 * aki.forward(ROBOT.poses["park"] - aki.zero)[:3, 3]
    told = re.findall(r"^(\S+): (\S+)(?: (\S+) (\S+))?$", said.out, re.MULTILINE)
    assert [name for name, *_ in told] == ["puma560", "puma560", "kept"]
    assert np.allclose([[float(word) for word in words] for _, *words in told[:2]], [[x, y, z]] * 2, atol=0.3)
    assert float(told[2][1]) == pytest.approx(x, abs=0.3)
    assert "2 presses" in said.out
    assert "teach: a null pointer was given" in said.err
    assert not rig.rows()["fault"].any()


NO_LINE = {
    "c": """\
#include <arcl.h>
int main(void)
{
    ROBOT *rp = arcl_open(0);
    iod_write(new_iod(rp, IOD_OUT, 5, 1), 1);
    return 0;
}
""",
    "py": """\
from qrobot.arcl import *
rp = arcl_open(0)
iod_write(new_iod(rp, IOD_OUT, 5, 1), 1)
""",
}


@pytest.mark.parametrize("kind", ["--offline", "--lockstep"])
@pytest.mark.parametrize("language", NO_LINE)
def test_a_program_that_asks_for_an_output_which_its_deployment_file_does_not_have_is_told(
    language: str, kind: str, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    program = tmp_path / f"program.{language}"
    program.write_text(NO_LINE[language])
    if language == "c":
        program = compiled(program, tmp_path)
    assert run_app(make_app("run"), ["run", kind, str(program)]) == 1
    told = " ".join(capfd.readouterr().err.split())
    assert "new_iod: output 5 of puma560 is not configured; the deployment file has none" in told


@pytest.mark.sampled(2)
@pytest.mark.parametrize("standard", ["cc -std=gnu89", "cc -std=c99", "cc -std=gnu17", CPP11, CPP20])
def test_the_papers_program_compiles_without_a_warning(standard: str, tmp_path: Path) -> None:
    language = ["-x", "c++"] if "c++" in standard else []
    for name in STREAMS:
        command = [*standard.split(), "-Wall", "-Wextra", "-Werror", f"-I{toolchain.ARCL_INCLUDE}", *language]
        subprocess.run([*command, "-c", str(EXAMPLES / f"{name}.c"), "-o", str(tmp_path / "x.o")], check=True)


@pytest.mark.parametrize("standard", ["cc -std=gnu17", CPP11])
def test_numbers_of_all_types_may_stand_in_a_list(standard: str, tmp_path: Path) -> None:
    types = ("char", "short", "int", "long", "long long", "float", "double")
    types += tuple(f"unsigned {each}" for each in types[:5])
    given = ", ".join(f"MOV_TIME, ({each}) 100" for each in types)
    (tmp_path / "each.c").write_text(f"#include <arcl.h>\nvoid each(ROBOT *rp, Pos *p) {{ move(rp, p, {given}, 0); }}")
    command = [*standard.split(), "-Wall", "-Wextra", "-Werror", f"-I{toolchain.ARCL_INCLUDE}"]
    language = ["-x", "c++"] if "c++" in standard else []
    subprocess.run([*command, *language, "-c", str(tmp_path / "each.c"), "-o", str(tmp_path / "x.o")], check=True)


def test_numbers_and_calls_of_the_header_are_those_of_the_package() -> None:
    numbers: dict[str, int] = {}
    for group in re.findall(r"^enum \{(.*?)\};", HEADER, re.MULTILINE | re.DOTALL):
        number = -1
        for name, value in re.findall(r"(\w+)(?: = (\d+))?(?:,|\s*$)", group):
            number = int(value) if value else number + 1
            numbers[name] = number
    for one in (*Attribute, *ArclEvent, *Grip):
        assert numbers.pop(one.name) == one.value
    assert set(numbers) == {"TRAJ_JOINT", "TRAJ_CART", "CONST", "VARB", "HOLD", "FNDEF", "IOD_IN", "IOD_OUT"}
    assert (numbers["TRAJ_JOINT"], numbers["TRAJ_CART"]) == (arcl.TRAJ_JOINT, arcl.TRAJ_CART)
    functions, macros = r"^\w+ \*?(\w+)\(", r"^#define (\w+)\(\."
    offered = {name for pattern in (functions, macros) for name in re.findall(pattern, HEADER, re.MULTILINE)}
    assert sorted(set(CALLS) - offered) == []
    described = set(re.findall(r"\w+", PAGE))
    assert sorted(name for name in set(CALLS) - described) == []
