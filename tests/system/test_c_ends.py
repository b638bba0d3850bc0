"""How programs in C end: with motions that wait, by falling off their end, by a mistake in a call."""

from __future__ import annotations

import re
import signal
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from qrobot.motion import Termination
from qrobot.rccl.c.program import run_executable
from qrobot.rccl.trace import Trace
from tests.support.c_programs import compiled_text, keyboard, needs_compiler, offline
from tests.support.signals import default_signals

pytestmark = [needs_compiler, pytest.mark.usefixtures("own_cache")]

GOAL = 'POS_PTR goal() { return jposition("P", 10., -50., 175., 0., 45., 0.); }\n'
GOAL_RAD = np.radians([10.0, -50.0, 175.0, 0.0, 45.0, 0.0])


@pytest.fixture(scope="module")
def folder(own_cache: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("ends")


def ended(text: str, folder: Path) -> tuple[object, list[Trace]]:
    """Exit status of a program that is run off line, and what it has done."""
    return offline(lambda: run_executable(compiled_text(GOAL + text, folder)))


def arrived(traces: list[Trace]) -> bool:
    return bool(traces) and traces[-1].requests[-1].code == Termination.COMPLETED


@pytest.mark.parametrize(
    "program",
    [
        "main() { move(park); move(goal()); }",
        "main() { move(park); move(goal()); return 0; }",
        "#include <stdlib.h>\nmain() { move(park); move(goal()); exit(0); }",
        "pumatask() { move(park); move(goal()); }",
        "int far; each() { far = 1; } main() { control(each); move(park); evalfn(each); move(goal()); }",
    ],
)
def test_motions_that_wait_when_a_program_ends_are_done_first(program, folder: Path, capfd) -> None:
    """Programs of the papers end with a `move`: Hayward & Paul 1986, sections 2.2.3, 3.3 (data base), 3.4.2 (crank)."""
    status, traces = ended(program, folder)
    assert (status, capfd.readouterr().err) == (0, "")
    assert arrived(traces)
    assert traces[-1].setpoints.q[-1] == pytest.approx(GOAL_RAD, abs=1e-9)


@pytest.mark.parametrize(
    ("program", "status", "said"),
    [
        ("main() { move(park); move(goal()); return 3; }", 3, "ended with status 3: 2 motions were not done"),
        ("main() { move(goal()); release(); return 0; }", 0, "release: 1 motion was not done"),
        ("main() { move(goal()); terminate = YES; }", 1, "the program has set `terminate`: 1 motion was not done"),
    ],
)
def test_a_program_that_ends_otherwise_stops_the_arm_and_says_what_was_left(
    program, status, said, folder, capfd
) -> None:
    assert ended(program, folder)[0] == status
    assert said in capfd.readouterr().err


@pytest.mark.parametrize("motions", [1, 2])
def test_a_program_that_sets_terminate_while_its_last_motions_are_done_ends_with_status_1(
    motions: int, folder: Path, capfd
) -> None:
    text = f"""
    each() {{ if (how.time > 1500.) terminate = YES; }}
    main() {{ mess = "no part"; control(each); setime(200., 5000.); {motions * "move(goal()); "} }}
    """
    status, (trace,) = ended(text, folder)
    said = capfd.readouterr().err
    assert status == 1
    assert f"the program has set `terminate`: {motions} motion{'s were' if motions > 1 else ' was'} not done\n" in said
    assert said.endswith("no part\n")
    assert not arrived([trace])
    assert len(trace.setpoints.q) < 100  # of 5.4 s and more


def test_a_program_that_sets_terminate_when_all_is_done_ends_with_status_1(folder: Path, capfd) -> None:
    text = """
    POS_PTR p;
    each() { if (p && p->code) terminate = YES; }
    main() { control(each); move(p = goal()); }
    """
    status, traces = ended(text, folder)
    assert status == 1
    assert capfd.readouterr().err.endswith(": the program has set `terminate`\n")
    assert arrived(traces)


@pytest.mark.parametrize(
    "program", ["main() { move(goal()); stop(0); }", "main() { move(goal()); stop(0); release(); }"]
)
def test_motions_that_the_program_has_forgotten_itself_are_not_left(program, folder, capfd) -> None:
    status, traces = ended(program, folder)
    assert (status, capfd.readouterr().err) == (0, "")
    assert not arrived(traces)


def test_a_motion_that_cannot_be_done_in_the_end_is_no_good_end(folder: Path, capfd) -> None:
    text = """
    TRSF_PTR e; POS_PTR p;
    goes(t) TRSF_PTR t; { t->p.x = 400. + .5 * how.time; }
    main() {
        e = gentr_trsl("E", 0., 0., 100.);
        p = makeposition("AWAY", t6, e, EQ, gentr_rot("T", 0., 50., -300., yunit, 180.), newtrans("OUT", goes), TL, e);
        setmode('c'); setvel(100., 90.);
        move(p);
    }
    """
    assert ended(text, folder)[0] == 1
    assert "the program has ended, but not all its motions were done: AWAY: " in capfd.readouterr().err


@pytest.mark.parametrize(
    "body",
    [
        'printf("a text of many letters\\n");',
        'int i; for (i = 0; i < 7; i++) printf("%d", i);',
        "move(park); waitfor(completed)",
    ],
)
def test_a_main_that_falls_off_its_end_has_the_status_0(body: str, folder: Path) -> None:
    assert ended(f"main() {{ {body} }}", folder)[0] == 0


def test_the_program_on_the_page_ends_with_status_0(folder: Path, capfd) -> None:
    page = (Path(__file__).parents[2] / "docs/how-to/run-a-legacy-c-program.md").read_text()
    (text,) = re.findall(r"```c\n(.*?)```", page, re.DOTALL)
    status, (trace,) = ended(text, folder)
    assert (status, capfd.readouterr().err) == (0, "")
    assert [(request.name, request.code) for request in trace.requests] == [("P", -1), ("P", -1), ("park", -1)]


@pytest.mark.parametrize("event", ["completed", "p->end"])
@pytest.mark.parametrize("drop", ["stop(0);", "nextmove = 9;"])
def test_a_motion_that_is_dropped_before_it_begins_can_be_waited_for(drop, event, folder: Path, capfd) -> None:
    text = f'POS_PTR p; main() {{ move(p = goal()); {drop} waitfor({event}); printf("%d", p->code); return 0; }}'
    assert ended(text, folder)[0] == 0
    assert capfd.readouterr().out == ("-2" if drop.startswith("stop") else "9")


@pytest.mark.sampled(8)
@pytest.mark.parametrize(
    ("call", "needed"),
    [
        ("evalfn(0)", "evalfn: a function is needed"),
        ('newtrans("A", 0)', "newtrans: const, varb, hold or a function is needed"),
        ("rot(0, yunit, 5.)", "rot: a transform is needed"),
        ("rot(t, 0, 5.)", "rot: a vector is needed"),
        ('gentr_rot("A", 0., 0., 0., 0, 5.)', "gentr_rot: a vector is needed"),
        ("trmult(t, t, 0)", "trmult: a transform is needed"),
        ("invert(0, t)", "invert: a transform is needed"),
        ("assigntr(t, 0)", "assigntr: a transform is needed"),
        ("printr(0, stdout)", "printr: a transform is needed"),
        ("makedb(0)", "makedb: the name of a file is needed"),
        ("static char name[300]; memset(name, 'n', 299); makedb(name)", "makedb: the name of the file is too long"),
        ("enctoang(0, 0)", "enctoang: an array for the result is needed"),
        ("move(0)", "this is no position"),
        ("update(t, 0)", "this is no position"),
        ("distance(0, 1.)", "name directions"),
    ],
)  # fmt: skip
def test_a_null_pointer_gets_an_error_that_names_the_call(call, needed, folder: Path, capfd) -> None:
    text = f'TRSF_PTR t; main() {{ t = newtrans("T", varb); {call}; printf("went on"); return 0; }}'
    status, _ = ended(text, folder)
    said = capfd.readouterr()
    assert (status, said.out) == (1, "")
    assert needed in said.err


@pytest.mark.parametrize(
    ("sent", "expected"),
    [
        ("kill(getpid(), SIGINT);", 130),
        ("kill(getppid(), SIGTERM);", 143),  # `kill` and the number of `qrobot run`
        ("kill(getppid(), SIGHUP); kill(getpid(), SIGHUP);", 129),  # a terminal that is closed tells all
    ],
)
def test_a_signal_stops_the_arm_in_its_last_motions_too(sent: str, expected: int, folder: Path, capfd) -> None:
    text = f"""
    #include <signal.h>
    #include <unistd.h>
    int left;
    each() {{ if (left && how.time > 1500.) {{ left = 0; {sent} }} }}
    main() {{ control(each); setime(200., 5000.); move(goal()); left = 1; }}
    """
    with default_signals(signal.SIGHUP):
        status, (trace,) = ended(text, folder)
    assert status == expected
    assert "interrupted; the arm is brought to rest" in capfd.readouterr().err
    assert trace.requests[-1].code == Termination.STOPPED
    assert len(trace.setpoints.q) < 100  # of 5.4 s


def test_sigterm_that_comes_while_a_program_is_started_ends_it(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    class Start(subprocess.Popen[bytes]):
        def __init__(self, *words: Any, **settings: Any) -> None:
            signal.raise_signal(signal.SIGTERM)
            super().__init__(*words, **settings)

    program = compiled_text("#include <unistd.h>\nmain() { for (;;) pause(); }", folder)
    monkeypatch.setattr("qrobot.c_transport.program.subprocess.Popen", Start)
    assert offline(lambda: run_executable(program))[0] == 143
    assert "program: ended by SIGTERM (Terminated)\n" in capfd.readouterr().err


@pytest.mark.parametrize(("call", "typed"), [("sample(20.);", ""), ("stepmode();", "world dx 0\n")])
def test_ctrl_c_stops_the_arm_while_a_call_waits_for_its_motions(call: str, typed: str, folder: Path, capfd) -> None:
    text = f"""
    #include <signal.h>
    #include <unistd.h>
    int left;
    each() {{ if (left && how.time > 1500.) {{ left = 0; kill(getpid(), SIGINT); }} }}
    main() {{ control(each); setime(200., 5000.); move(goal()); move(park); left = 1; {call} }}
    """
    with keyboard(typed):
        status, traces = ended(text, folder)
    assert status == 130
    assert traces[0].requests[0].code == Termination.STOPPED
    assert len(traces[0].setpoints.q) < 100  # of 10.8 s


def test_a_second_update_of_a_transform_by_one_motion_is_refused(folder: Path, capfd) -> None:
    text = """
    TRSF_PTR a; POS_PTR p;
    main() {
        a = gentr_trsl("A", 0., 400., 200.);
        p = makeposition("P", t6, EQ, a, TL, a);
        update(a, p); update(a, p);
    }
    """
    assert ended(text, folder)[0] == 1
    assert "update(A, P): the next motion has to update A already" in capfd.readouterr().err
