"""C programs that end in the middle of something: in a handler of a signal, in a function, in handlers of exit()."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from qrobot.wire import Mode
from tests.support.c_programs import compiled_text, needs_compiler, ran
from tests.support.faked_c_programs import MOVING, Run, part_of_the_way, rests_on_its_way, robot, run
from tests.support.processes import FIRST_START_S
from tests.support.puma import PARK

__all__ = ["robot", "run"]  # the fixtures

pytestmark = [needs_compiler, pytest.mark.usefixtures("own_cache")]

SAMPLED = f"control(each); {MOVING} moving = 1;"  # after which each() may see that it moves


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
    main() {{ signal(SIGINT, onintr); mess = "taken apart"; {SAMPLED}
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
    main() {{ log = fopen("{tmp_path}/log", "w"); {SAMPLED} waitfor(completed) return 5; }}
    """
    assert run(text) == status
    assert capfd.readouterr().err == ""
    assert (tmp_path / "log").read_text() == "bad\n"
    assert part_of_the_way(robot)


def test_an_interrupt_that_meets_a_function_which_asks_ends_as_any_other(run: Run, robot, capfd) -> None:
    text = f"""
    #include <signal.h>
    #include <unistd.h>
    int moving;
    TRSF_PTR a;
    each() {{ int i; if (moving) {{ moving = 0; kill(getpid(), SIGINT); for (i = 0; i < 500; i++) trmult(a, a, a); }} }}
    main() {{ a = newtrans("A", varb); {SAMPLED} waitfor(completed) }}
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


def test_handlers_of_exit_that_a_program_has_registered_first_still_have_the_arm(run: Run, robot, capfd) -> None:
    text = """
    #include <stdlib.h>
    tidy() { OPEN; move(park); waitfor(completed) release("bye"); }
    main() { atexit(tidy); move(jposition("P", 10., -90., 180., 0., 0., 0.)); waitfor(completed) return 0; }
    """
    assert run(text) == 0
    told = capfd.readouterr()
    assert (told.out, told.err) == ("bye\n", "")
    assert robot.mode is Mode.HOLDING
    assert robot.q == pytest.approx(PARK)


TASK = """
#include "rci.h"
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>
static RCI_TASK *td;
static void rest(RCI_TASK *td) { (void) td; }
static int over(void) { return rci_runs(td) > 2; }
static void tell(void) { if (rci_runs(td) > 2) printf("ran\\n"); }
int main(void)
{
    int status;
    atexit(tell);
    if ((td = rci_create("watch", "")) == 0 || rci_control(td, rest, 0, 0) || rci_onclock(td, 1, 0))
        return 6;
    if (rci_start(td->bit) || rci_wait(over))
        return 7;
    fflush(stdout);
    if (fork() == 0) {
        fclose(stdout);
        fclose(stderr);
        exit(rci_state(td) == RCI_ENDED && rci_descriptor("watch") == 0 && rci_close() == 0 ? 3 : 4);
    }
    wait(&status);
    return WEXITSTATUS(status) == 3 ? 0 : 8;
}
"""


def test_tasks_outlast_the_handlers_of_exit_and_no_child_waits_for_their_threads(tmp_path: Path) -> None:
    assert ran(compiled_text(TASK, tmp_path)) == (0, "ran\n", "")


def test_a_program_that_goes_into_the_background_before_its_tasks_start_takes_them_along(tmp_path: Path) -> None:
    text = TASK.replace(
        "    if (rci_start", "    if (fork()) { wait(&status); _exit(WEXITSTATUS(status)); }\n    if (rci_start"
    )
    assert ran(compiled_text(text, tmp_path)) == (0, "ran\n", "")


def test_a_program_that_waits_for_all_its_children_does_not_wait_for_its_engine(tmp_path: Path) -> None:
    text = """
    #include <sys/wait.h>
    #include <unistd.h>
    main() { newtrans("A", varb); if (!fork()) _exit(0); while (wait((int *) 0) != -1); return 0; }
    """
    program = compiled_text(text, tmp_path)
    assert subprocess.run([program], check=False, timeout=FIRST_START_S).returncode == 0


def test_a_program_that_was_started_without_standard_streams_says_nothing_to_its_engine(tmp_path: Path) -> None:
    """Its channels would be what it prints to."""
    text = """
    main() {
        TRSF_PTR a = gentr_trsl("A", 1., 2., 3.), b = newtrans("B", varb);
        printf("hello\\n"); fflush(stdout);
        trmult(b, a, a);
        return getchar() == EOF && b->p.x == 2. ? 0 : 7;
    }
    """
    python = tmp_path / "python"  # of its engine
    look = f'streams=$(readlink /proc/$$/fd/1 /proc/$$/fd/2); echo "$streams" > {tmp_path}/streams'
    python.write_text(f'#!/bin/sh\n{look}\nexec {sys.executable} "$@"\n')
    python.chmod(0o755)
    command = ["sh", "-c", 'exec "$0" <&- >&- 2>&-', compiled_text(text, tmp_path)]
    surroundings = os.environ | {"QROBOT_PYTHON": str(python)}
    assert subprocess.run(command, check=False, timeout=FIRST_START_S, env=surroundings).returncode == 0
    assert (tmp_path / "streams").read_text() == "/dev/null\n" * 2


def test_tasks_whose_thread_could_not_be_made_start_another_time(tmp_path: Path) -> None:
    text = (
        """
    #define _GNU_SOURCE
    #include <dlfcn.h>
    #include <errno.h>
    #include <pthread.h>
    """
        + TASK.replace("    if (rci_start", "    if (rci_start(td->bit) != -1) return 9;\n    if (rci_start")
        + """
    int pthread_create(pthread_t *thread, const pthread_attr_t *attr, void *(*start)(void *), void *given)
    {
        static int calls;
        int (*create)(pthread_t *, const pthread_attr_t *, void *(*)(void *), void *);
        *(void **) &create = dlsym(RTLD_NEXT, "pthread_create");
        return calls++ ? create(thread, attr, start, given) : EAGAIN;
    }
    """
    )
    status, out, _ = ran(compiled_text(text, tmp_path))
    assert (status, out) == (0, "ran\n")


@pytest.mark.parametrize("first", [False, True])
def test_a_child_that_lives_on_does_not_hide_the_crash_of_its_program(
    first: bool, run: Run, robot, tmp_path: Path
) -> None:
    born = "if (!(child = fork())) { sleep(1000); _exit(0); }"
    text = f"""
    #include <unistd.h>
    int moving;
    each() {{ }}
    main() {{
        int child;
        FILE *file;
        {born if first else ""}
        {SAMPLED}
        {"" if first else born}
        fprintf(file = fopen("{tmp_path}/child", "w"), "%d", child);
        fclose(file);
        *(volatile int *) 8 = 1;
    }}
    """
    assert run(text) == 139
    os.kill(int((tmp_path / "child").read_text()), signal.SIGKILL)  # it was there
    assert rests_on_its_way(robot)
