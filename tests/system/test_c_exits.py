"""C programs that end in the middle of something: in a handler of a signal, in a function, in handlers of exit()."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from qrobot import rccl
from qrobot.rccl.c.program import run_executable
from qrobot.rci import VirtualLink
from qrobot.wire import Mode
from tests.support.c_programs import compiled_text, needs_compiler
from tests.support.fake_robot import FakeRobot
from tests.support.puma import PARK

pytestmark = [needs_compiler, pytest.mark.usefixtures("own_cache")]

MOVING = """
    POS_PTR p = jposition("P", 40., -90., 180., 0., 0., 0.);
    control(each);
    setime(100, 4000);
    move(p);
    waitas(p->scal > .3)
    moving = 1;
"""
Run = Callable[[str], int]


@pytest.fixture
def robot() -> Iterator[FakeRobot]:
    fake = FakeRobot(tuple(PARK))
    with rccl.use(lambda hello: VirtualLink(hello, fake.transfer)):
        yield fake


@pytest.fixture
def run(robot: FakeRobot, tmp_path: Path) -> Run:
    """The exit status of a program with this text."""
    return lambda text: run_executable(compiled_text(text, tmp_path))


def is_on_its_way(robot: FakeRobot) -> bool:
    return 0.1 < robot.path[-1][0] - PARK[0] < 0.6


def rests_on_its_way(robot: FakeRobot) -> bool:
    """The program let go of it in order: whoever breaks off leaves it tracking."""
    return bool(robot.goodbyes) and robot.mode is Mode.HOLDING and is_on_its_way(robot)


@pytest.mark.parametrize(
    ("handler", "status", "said"),
    [
        ("exit(3);", 3, "taken apart\n"),
        ('release("interrupted"); exit(3);', 1, "must not call"),
        ("stop(0.);", 1, "must not call"),
        ("longjmp(back, 1);", 1, "must not call, nor jump out of it"),
    ],
)
def test_a_handler_that_interrupts_a_call_ends_the_program_and_the_arm_rests_first(
    handler, status, said, run: Run, robot, capfd
) -> None:
    """The signal comes while the foreground waits in a call: no other time passes."""
    text = f"""
    #include <setjmp.h>
    #include <signal.h>
    #include <unistd.h>
    jmp_buf back;
    int moving;
    each() {{ if (moving) {{ moving = 0; kill(getpid(), SIGINT); }} }}
    onintr() {{ {handler} }}
    main() {{ signal(SIGINT, onintr); mess = "taken apart"; {MOVING}
              if (setjmp(back) == 0) waitfor(completed)
              move(park); return 0; }}
    """
    assert run(text) == status
    assert said in capfd.readouterr().err
    assert rests_on_its_way(robot)


@pytest.mark.parametrize("status", [0, 3])
def test_a_function_at_a_sample_may_end_the_program(status: int, run: Run, robot, tmp_path: Path, capfd) -> None:
    """No sample can be finished without it, so the bridge brings the arm to rest."""
    text = f"""
    int moving;
    FILE *log;
    each() {{ if (moving) {{ fprintf(log, "bad\\n"); exit({status}); }} }}
    main() {{ log = fopen("{tmp_path}/log", "w"); {MOVING} waitfor(completed) return 5; }}
    """
    assert run(text) == status
    assert capfd.readouterr().err == ""
    assert (tmp_path / "log").read_text() == "bad\n"
    assert is_on_its_way(robot)


def test_an_interrupt_that_meets_a_function_which_asks_ends_as_any_other(run: Run, robot, capfd) -> None:
    text = f"""
    #include <signal.h>
    #include <unistd.h>
    int moving;
    TRSF_PTR a;
    each() {{ int i; if (moving) {{ moving = 0; kill(getpid(), SIGINT); for (i = 0; i < 500; i++) trmult(a, a, a); }} }}
    main() {{ a = newtrans("A", varb); {MOVING} waitfor(completed) }}
    """
    assert run(text) == 130
    assert capfd.readouterr().err == "\nprogram: interrupted; the arm is brought to rest\n"
    assert rests_on_its_way(robot)


def test_a_child_of_the_program_has_no_arm(run: Run, robot, capfd) -> None:
    text = """
    #include <sys/wait.h>
    #include <unistd.h>
    main() {
        int status;
        TRSF_PTR a = gentr_trsl("A", 1., 2., 3.), b = newtrans("B", varb);
        if (!fork()) { trmult(b, a, a); _exit(0); }
        wait(&status);
        trmult(b, a, a);
        return b->p.x == 2. ? WEXITSTATUS(status) : 7;
    }
    """
    assert run(text) == 1
    assert "program: a child of the program has no arm" in capfd.readouterr().err
