"""`nextmove` of a C program in the first half of a transition, whoever sets it and whichever motion has an `evalfn`."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import pytest

from qrobot.c_transport.program import run_served
from qrobot.multi_rccl.c.__main__ import other_release
from qrobot.multi_rccl.c.dispatcher import ManipDispatcher
from qrobot.rccl.c.program import run_executable
from tests.support.c_programs import CHECKED, compiled_text, needs_compiler, offline

pytestmark = [needs_compiler, pytest.mark.usefixtures("own_cache")]

ONE_ARM = """
#define TAKE control(each)
#define ARM
#define PLACE(...) makeposition("P", t6, __VA_ARGS__)
"""
MANIPULATOR = """
static MANIP *arm;
#define TAKE rccl_control(arm = rccl_open("puma560"))
#define ARM arm,
#define PLACE(...) makePosition(TRANS, __VA_ARGS__)
#define nextmove arm->nextmove
#define nbrequest arm->nbrequest
#define completed arm->completed
"""
BODY = r"""
#include <string.h>

static POS_PTR a, b;
static char who;
static int armed;

static speak(me)
{
    if (armed && who == me && nbrequest == 0 && a->code == 0) {
        armed = 0;
        nextmove = 7;
    }
}

static of_older() { speak('o'); }
static of_younger() { speak('y'); }
static each() { speak('c'); }
static still(t) TRSF_PTR t; { speak('t'); }

main(argc, argv) char **argv;
{
    TRSF_PTR tool = gentr_trsl("tool", 0., 0., 100.);
    who = argv[1][0];
    a = PLACE(tool, EQ, gentr_rot("near", 500., 50., -300., yunit, 180.), TL, tool);
    b = PLACE(tool, EQ, gentr_rot("far", 500., 250., -300., yunit, 180.), newtrans("still", still), TL, tool);
    TAKE;
    setmode(ARM 'c');
    setime(ARM 600., 1500.);
    if (strchr(argv[2], 'o'))
        evalfn(ARM of_older);
    move(ARM a);
    if (strchr(argv[2], 'y'))
        evalfn(ARM of_younger);
    move(ARM b);
    armed = 1;
    waitas(nbrequest == 0)
    speak('m');
    waitfor(completed)
    printf("%d %d %d\n", armed, a->code, b->code);
    return 0;
}
"""
WHO: Final = {"main program": "m", "transform": "t", "control": "c", "older": "o", "younger": "y"}
GUARDED: Final = {"no evalfn": "-", "older guarded": "o", "younger guarded": "y", "both guarded": "oy"}
CASES: Final = {
    f"{name}, {which}": (who, guarded)
    for name, who in WHO.items()
    for which, guarded in GUARDED.items()
    if who in "mtc" or who in guarded
}
OF_MANIPULATORS: Final = {name: case for name, case in CASES.items() if case[0] != "c"}


@pytest.fixture(scope="module")
def one_arm(own_cache: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program of RCCL 1.0."""
    return compiled_text(ONE_ARM + BODY, tmp_path_factory.mktemp("nextmove"), *CHECKED, name="one_arm")


@pytest.fixture(scope="module")
def manipulator(own_cache: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """That of Multi-RCCL, in which no function is given to `control`."""
    return compiled_text(MANIPULATOR + BODY, tmp_path_factory.mktemp("nextmove"), *CHECKED, name="manipulator")


def expect_codes(who: str, capfd: pytest.CaptureFixture[str]) -> None:
    """What the program prints: that it was said, and both codes."""
    said, older, younger = capfd.readouterr().out.split()
    assert said == "0"
    assert (older, younger) == (("7", "-1") if who == "o" else ("-1", "7"))


@pytest.mark.sampled(6)
@pytest.mark.parametrize(("who", "guarded"), CASES.values(), ids=CASES)
def test_nextmove_ends_the_younger_motion_unless_the_function_of_the_older_sets_it(
    who: str, guarded: str, one_arm: Path, capfd
) -> None:
    status, _ = offline(lambda: run_executable(one_arm, (who, guarded)))
    assert status == 0
    expect_codes(who, capfd)


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("who", "guarded"), OF_MANIPULATORS.values(), ids=OF_MANIPULATORS)
def test_nextmove_of_a_manipulator_ends_its_younger_motion_likewise(
    who: str, guarded: str, manipulator: Path, capfd
) -> None:
    languages = [other_release, other_release, ManipDispatcher]
    status, _ = offline(lambda: run_served(manipulator, (who, guarded), languages))
    assert status == 0
    expect_codes(who, capfd)
