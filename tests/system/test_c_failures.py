"""C programs that go wrong: what they say, how they end, and that their arm comes to rest."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from qrobot.c_transport import engine
from qrobot.cli import toolchain
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.errors import ConfigError, LinkLost
from qrobot.faultcodes import FaultCode
from qrobot.rccl.c.program import run_executable
from qrobot.wire import Mode
from tests.support.c_programs import compiled_text, needs_compiler
from tests.support.fake_robot import FakeRobot
from tests.support.faked_c_programs import MOVING, Run, at_rest, rests_on_its_way, robot, run
from tests.support.patience import give_time, wait_until
from tests.support.signals import default_signals

__all__ = ["robot", "run"]  # the fixtures

pytestmark = pytest.mark.usefixtures("own_cache")


@pytest.fixture(autouse=True)
def hearing() -> Iterator[None]:
    """Programs hear every signal."""
    with default_signals(signal.SIGHUP, signal.SIGTERM):
        yield


@needs_compiler
@pytest.mark.parametrize(
    ("last", "status", "told"),
    [
        ("*(volatile int *) 8 = 1;", 139, "program: ended by SIGSEGV (Segmentation fault)\n"),
        ("abort();", 134, "program: ended by SIGABRT (Aborted)\n"),
        ("kill(getpid(), 40);", 168, "program: ended by signal 40 (Real-time signal 6)\n"),
        ("exit(3);", 3, ""),
        ("return 5;", 5, ""),
    ],
)
def test_however_a_program_ends_its_arm_comes_to_rest_on_its_way(
    last: str, status: int, told: str, run: Run, robot, capfd
) -> None:
    assert run(f"main() {{ {MOVING} {last} }}") == status
    assert rests_on_its_way(robot)
    said = capfd.readouterr().err
    assert told in said
    assert bool(told) == ("ended by" in said)


@needs_compiler
@pytest.mark.parametrize(("name", "status"), [("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 129)])
def test_a_program_in_an_endless_loop_is_ended_by_a_signal_and_says_its_mess(
    name: str, status: int, run: Run, robot, capfd
) -> None:
    loop = f'mess = "taken apart"; {MOVING} kill(getpid(), {name}); for (;;);'
    assert run(f"#include <signal.h>\nmain() {{ {loop} }}") == status
    assert rests_on_its_way(robot)
    said = capfd.readouterr().err
    assert "program: interrupted; the arm is brought to rest\ntaken apart\n" in said


TERMINAL = """
import os, pty, sys
pid, screen = pty.fork()
if pid == 0:
    os.execv(sys.argv[1], sys.argv[1:])
seen = b""
while b"on its way" not in seen:
    seen += os.read(screen, 100)
os.close(screen)
sys.exit(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
"""


@needs_compiler
def test_a_terminal_that_is_closed_ends_its_program_in_order(robot, tmp_path: Path) -> None:
    (tmp_path / "terminal.py").write_text(TERMINAL)
    text = f'#include <unistd.h>\nmain() {{ {MOVING} printf("on its way\\n"); fflush(stdout); for (;;) pause(); }}'
    window = tmp_path / "window"
    window.write_text(f"#!/bin/sh\nexec {sys.executable} {tmp_path}/terminal.py {compiled_text(text, tmp_path)}\n")
    window.chmod(0o755)
    assert run_executable(window) == 129
    assert rests_on_its_way(robot)


@needs_compiler
@pytest.mark.parametrize(
    ("name", "signals", "status", "at_once"),
    [
        ("SIGINT", 1, 130, False),
        ("SIGINT", 10_000, 130, True),
        ("SIGTERM", 10_000, 143, True),
        ("SIGHUP", 10_000, 129, False),  # of a terminal that is closed the kernel tells, and its shell too
    ],
)
def test_a_program_waits_for_its_arm_to_come_to_rest_unless_it_is_interrupted_twice(
    name: str, signals: int, status: int, at_once: bool, run: Run, robot: FakeRobot, tmp_path: Path
) -> None:
    """Two signals that arrive together are one, hence many."""
    ended_before, interrupted = False, tmp_path / "interrupted"

    def has_ended() -> bool:
        return os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None

    def watch(seq: int) -> None:
        nonlocal ended_before
        if robot.mode is not Mode.TRACKING or not interrupted.exists():
            return
        if at_once:
            wait_until(has_ended, "the program ends before its arm rests")  # an arm that takes its time
        give_time(0.01)  # for a program that would not wait
        ended_before = ended_before or has_ended()

    robot.before_period = watch
    text = """
    #include <fcntl.h>
    #include <signal.h>
    #include <unistd.h>
    main() {
        int parent = getpid(), left = %d;
        %s
        if (!fork()) {
            while (left-- && getppid() == parent) { creat("%s", 0600); kill(parent, %s); usleep(20000); }
            _exit(0);
        }
        for (;;) pause();
    }
    """
    assert run(text % (signals, MOVING, interrupted, name)) == status
    assert ended_before == at_once
    assert at_rest(robot)


@needs_compiler
def test_a_program_keeps_its_own_handler_of_a_signal(run: Run, robot, capfd) -> None:
    text = """
    #include <signal.h>
    int caught;
    handler() { caught = 1; nextmove = YES; }
    main() { signal(SIGINT, handler); %s kill(getpid(), SIGINT); waitfor(completed)
             printf("caught %%d, code %%d\\n", caught, p->code); return 0; }
    """
    assert run(text % MOVING) == 0
    assert "caught 1, code 1" in capfd.readouterr().out


@needs_compiler
@pytest.mark.parametrize(
    ("call", "complaint"),
    [
        ('move(makeposition("FAR", t6, EQ, gentr_trsl("T", 5000, 0, 0), TL, t6));', "FAR"),
        ('makeposition("P", t6, EQ, newtrans("T", const));', 'makeposition: write ("P", terms with t6, EQ'),
        ('distance("dz", 1., 2.);', "one value each"),
        ('distance("up", 1.);', "dx dy dz"),
        ("freetrans(t6);", "freetrans: t6, park and there are not"),
        ("freepos(park);", "freepos: t6, park and there are not"),
        ("setmode('x');", "mode 'x' is neither"),
        ("move((POS_PTR) &how);", "move: this is no position"),
        ("move(NULL);", "move: this is no position"),
        ('TRSF_PTR t = newtrans("T", varb); freetrans(t); freetrans(t);', "freetrans: this is no transform"),
        ("sample(700.);", "1 to 100"),
        ("nextmove = -4; stop(0.);", "the code must be positive"),
        ('saver(newtrans("T", varb));', "name its file with makedb"),
        ("terminate = YES; stop(0.);", "has set `terminate`"),
    ],
)
def test_a_call_that_is_refused_ends_the_program_with_the_reason(
    call: str, complaint: str, run: Run, robot, capfd
) -> None:
    assert run(f"main() {{ move(park); {call} return 0; }}") == 1
    said = capfd.readouterr().err
    assert said.startswith("program: ")
    assert complaint in said
    assert at_rest(robot)


@needs_compiler
@pytest.mark.parametrize("hand", [3, -1])
def test_a_hand_that_does_not_exist_is_never_sent_and_ends_the_program(hand: int, run: Run, robot, capfd) -> None:
    assert run(f"main() {{ control(); chg.hand = {hand}; suspendfg(); suspendfg(); }}") == 1
    assert f"hand {hand}: 0 to 2 exist" in capfd.readouterr().err
    assert {command.hand for command in robot.commands} == {0}


@needs_compiler
def test_waiting_for_what_cannot_happen_any_more_is_refused_in_lockstep(run: Run, robot, capfd) -> None:
    assert run('main() { POS_PTR p = jposition("P", 1., 2., 3., 4., 5., 6.); waitfor(p->end) }') == 1
    assert "no motion is left that could signal it" in capfd.readouterr().err


@needs_compiler
@pytest.mark.parametrize(
    ("body", "complaint"),
    [
        ("for (;;);", "has not come back within 0.3 s"),
        ("waitfor(completed)", "must not wait"),
        ("t->n.x = 2.;", "left no rigid transform"),
    ],
)
def test_a_function_that_goes_wrong_at_a_sample_ends_the_program(
    body: str, complaint: str, run: Run, robot, capfd, monkeypatch
) -> None:
    if "0.3 s" in complaint:
        monkeypatch.setattr(engine, "CALLBACK_S", 0.3)
    text = f"""
    slow(t) TRSF_PTR t; {{ if (nbrequest >= 0 && how.time > 200.) {{ {body} }} }}
    main() {{
        TRSF_PTR e = gentr_rot("E", 500., 0., -300., yunit, 180.), s = newtrans("S", slow);
        setmode('c');
        move(makeposition("P", t6, EQ, e, s, TL, e));
        waitfor(completed)
        return 0;
    }}
    """
    assert run(text) == 1
    assert complaint in capfd.readouterr().err


@needs_compiler
def test_a_crash_in_a_function_at_a_sample_ends_the_program_and_the_stream(run: Run, robot) -> None:
    text = """
    crash(t) TRSF_PTR t; { if (how.time > 200.) *(int *) 8 = 1; }
    main() {
        TRSF_PTR e = gentr_rot("E", 500., 0., -300., yunit, 180.), s = newtrans("S", crash);
        move(makeposition("P", t6, EQ, e, s, TL, e));
        waitfor(completed)
    }
    """
    assert run(text) == 139


@needs_compiler
def test_a_robot_that_goes_away_ends_the_program_at_its_next_call(run: Run, robot: FakeRobot, capfd) -> None:
    def gone(seq: int) -> None:
        if seq > 60:
            raise LinkLost("the bridge has gone")

    robot.before_period = gone
    assert run(f"main() {{ {MOVING} waitfor(p->end) return 0; }}") == 1
    assert "program: the bridge has gone" in capfd.readouterr().err


@needs_compiler
def test_a_program_that_ends_off_its_path_on_virtual_time_is_told_that_nobody_else_lets_it_go_on(
    run: Run, robot, capfd
) -> None:
    robot.before_period = lambda seq: robot.break_down(FaultCode.FOLLOWING) if seq == 60 else None
    text = """
    main() {
        control();
        rccl_keep_path(YES, 200., 30.);
        move(jposition("P", 40., -90., 180., 0., 0., 0.));
        return 0;
    }
    """
    assert run(text) == 1
    assert re.search("120 s of virtual time.*FOLLOWING", capfd.readouterr().err)


@needs_compiler
def test_a_program_that_keeps_its_path_sees_why_it_waits_and_goes_on_when_it_confirms(run: Run, robot, capfd) -> None:
    stops = [(10.0, lambda: robot.halt(FaultCode.COLLISION)), (30.0, lambda: robot.break_down(FaultCode.FOLLOWING))]

    def stop_it(_: int) -> None:
        if stops and robot.q[0] > np.radians(stops[0][0]):
            stops.pop(0)[1]()

    robot.before_period = stop_it
    text = """
    main() {
        control();
        rccl_override(90.);
        double soft[] = {30., 40., 20., 2., 2., 2.}, at[] = {0., 0., 50.};
        rccl_collision("comply", 0., soft);
        rccl_retract(20.);
        rccl_setload(0., at, NULL);
        rccl_keep_path(YES, 200., 30.);
        POS_PTR p = jposition("P", 40., -90., 180., 0., 0., 0.);
        move(p);
        waitas(*rccl_kept())
        printf("%s at %d\\n", strstr(rccl_kept(), "COLLISION") ? "COLLISION" : rccl_kept(), (int) (how.q[0] * 1e3));
        rccl_resume();
        waitas(how.mode == 7 && *rccl_kept())
        printf("mode %d: %s\\n", how.mode, rccl_kept());
        rccl_resume();
        waitas(!*rccl_kept())
        rccl_pause();
        rccl_resume();
        waitfor(completed)
        printf("code %d, kept '%s'\\n", p->code, rccl_kept());
        soft[3] = 99.;
        rccl_collision("retract", 20., soft);
        return 0;
    }
    """
    assert run(text) == 1
    told = capfd.readouterr()
    waited = re.match(r"COLLISION at (\d+)\n", told.out)
    assert waited
    assert 155 < int(waited[1]) < 168  # mrad of joint 1, by 20 mm of the flange: it met something at 182
    assert re.search(r"\nmode 7: .*FOLLOWING", told.out)
    assert told.out.endswith("code -1, kept ''\n")
    assert "threshold of joint 4: 99 is more than unexplained_torque" in told.err
    assert at_rest(robot)
    assert robot.q[0] == pytest.approx(np.radians(40.0))


@needs_compiler
def test_a_program_that_moves_no_arm_is_an_ordinary_program(run: Run, capfd) -> None:
    assert run('main() { printf("hello\\n"); return 4; }') == 4
    assert capfd.readouterr().out == "hello\n"


@needs_compiler
def test_without_its_engine_a_program_says_what_to_name(tmp_path: Path) -> None:
    program = compiled_text("main() { move(park); }", tmp_path)
    environment = {"QROBOT_PYTHON": "/nowhere/python"}
    done = subprocess.run([program], check=False, env=environment, capture_output=True, text=True)
    assert done.returncode == 1
    assert "name the Python that has qrobot in QROBOT_PYTHON" in done.stderr
    assert "program: the motion engine did not start" in done.stderr


@needs_compiler
def test_a_program_of_another_version_is_told_to_be_compiled_anew(run: Run, monkeypatch, capfd) -> None:
    monkeypatch.setattr(engine, "VERSION", engine.VERSION + 1)
    with pytest.raises(ConfigError, match="compile it anew"):
        run("main() { move(park); }")
    assert "program: this program was compiled by another version" in capfd.readouterr().err


def test_without_a_compiler_it_is_said_what_to_install(monkeypatch, capfd) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    assert run_app(make_app("cc"), ["cc", "prog.c", "-o", "prog"]) == 1
    said = capfd.readouterr().err
    assert "no C compiler no-such-compiler: install one (Debian, Ubuntu: apt install gcc libc6-dev" in said


@needs_compiler
def test_warnings_are_kept_back_until_they_are_asked_for(tmp_path: Path, capfd) -> None:
    compiled_text("main() { foo(1); } foo(a) { a; }", tmp_path)
    assert capfd.readouterr().err == ""
    compiled_text("main() { foo(1); } foo(a) { a; }", tmp_path, "-Wall")
    assert "warning" in capfd.readouterr().err


@needs_compiler
def test_its_own_sources_give_the_strictest_compiler_nothing_to_say(tmp_path: Path) -> None:
    folders = [f"-I{folder}" for folder in (toolchain.INCLUDE, toolchain.SOURCES)]
    for source in (*toolchain.SOURCES.glob("*.c"), *toolchain.MULTI_SOURCES.glob("*.c")):
        strict = [*toolchain.STRICT, "-Werror", *folders, '-DQROBOT_PYTHON="python"']
        subprocess.run([*toolchain.compiler(), *strict, "-c", source, "-o", tmp_path / "it.o"], check=True)
