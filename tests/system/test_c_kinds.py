"""C programs of other kinds: macros that make primitives, several files, own handlers of signals, and `select`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from qrobot.rccl.c.program import run_executable
from qrobot.rccl.trace import Trace
from tests.support.c_programs import compiled, compiled_text, needs_compiler, offline

pytestmark = [needs_compiler, pytest.mark.usefixtures("own_cache")]

CELL_H = """
#include "rccl.h"
#define FIXED const
#define FRAME(kind, name, ...) (name = gentr_##kind(#name, __VA_ARGS__))
#define PLACE(name, ...) makeposition(#name, t6, tool, EQ, __VA_ARGS__, TL, tool)
#define ABOVE(place, mm) do { distance("dz", -(mm)); move(place); } while (0)
#define WHEN(condition, ...) do { waitas(condition) __VA_ARGS__; } while (0)
#define VISIT(place) do { ABOVE(place, 50); move(place); WHEN(place->code != 0, seen++); } while (0)

TRSF_PTR tool, table, shift; /* defined here, and so in every file, as it was done then */
POS_PTR goal;
int seen;
POS_PTR in_words();
"""

CELL_C = """
#include "cell.h"
static int calls; /* each file has one */

static lift(t) TRSF_PTR t; { calls++; Trsl(t, 0., 0., -5.); }

POS_PTR in_words()
{
    tool = gentr_trsl("tool", 0., 0., 100.);
    table = gentr_rot("table", 500., 50., -300., yunit, 180.);
    shift = newtrans("shift", const);
    return makeposition("goal", t6, tool, EQ, table, shift, TL, tool);
}

slowly()
{
    in_words();
    goal = makeposition("slow", t6, tool, EQ, table, newtrans("lifted", lift), TL, tool);
    setmode('c');
    setime(200., 3000.);
    move(goal);
}

lifts() { return calls; }
"""

MAIN_C = r"""
#include <errno.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/select.h>
#include <sys/time.h>
#include <unistd.h>
#include "cell.h"

static volatile int calls, alarms, users;
static int ends[2];

static void on_alarm(int number) { alarms++; }
static void on_user(int number) { users++; }
static void on_end(int number) { nextmove = 7; }

static signals(number, handler) void (*handler)(int);
{
    struct sigaction action;
    memset(&action, 0, sizeof action); /* without SA_RESTART: what waits in the kernel comes back with EINTR */
    action.sa_handler = handler;
    sigaction(number, &action, NULL);
}

static each() { calls++; kill(getpid(), SIGUSR1); }
static ask() { if (++calls == 20) for (kill(getpid(), SIGUSR2); !nextmove;) usleep(100); }
static tell() { if (++calls == 20) write(ends[1], "x", 1); }

static tick(microseconds)
{
    struct itimerval every = {{0, microseconds}, {0, microseconds}};
    setitimer(ITIMER_REAL, &every, NULL);
}

static by_macros()
{
    FRAME(trsl, tool, 0., 0., 100.);
    FRAME(rot, table, 500., 50., -300., yunit, 180.);
    shift = newtrans("shift", FIXED);
    goal = PLACE(goal, table, shift);
    setmode('c');
    VISIT(goal);
}

static by_words()
{
    goal = in_words();
    setmode('c');
    distance("dz", -50.);
    move(goal);
    move(goal);
    waitas(goal->code != 0)
    seen++;
}

static interrupted()
{
    signals(SIGALRM, on_alarm);
    signals(SIGUSR1, on_user);
    tick(100); /* from before the program has its engine to its end */
    control(each);
    by_words();
    waitfor(completed)
    while (!alarms)
        pause();
    printf("%d\n", users > 0);
}

static ended_by_a_handler()
{
    signals(SIGUSR2, on_end);
    control(ask);
    slowly();
    waitfor(completed)
    printf("%d\n", goal->code);
}

static selects()
{
    struct timeval at_once;
    fd_set wanted;
    int ready;

    pipe(ends);
    control(tell);
    slowly();
    do {
        suspendfg();
        FD_ZERO(&wanted);
        FD_SET(ends[0], &wanted);
        memset(&at_once, 0, sizeof at_once);
        ready = select(ends[0] + 1, &wanted, NULL, NULL, &at_once);
    } while (ready == 0 && !completed);
    nextmove = ready == 1 && FD_ISSET(ends[0], &wanted) ? 9 : 1;
    waitfor(completed)
    printf("%d\n", goal->code);
}

main(argc, argv) char **argv;
{
    switch (argv[1][0]) {
    case 'm': by_macros(); break;
    case 'w': by_words(); break;
    case 'i': interrupted(); break;
    case 'e': ended_by_a_handler(); break;
    case 's': selects(); break;
    }
    waitfor(completed)
    release("done");
    printf("%s %d\n", goal->name, lifts() > 20);
    return 0;
}
"""


@pytest.fixture(scope="module")
def program(own_cache: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program made of both files."""
    folder = tmp_path_factory.mktemp("kinds")
    for name, text in {"cell.h": CELL_H, "cell.c": CELL_C, "main.c": MAIN_C}.items():
        (folder / name).write_text(text)
    return compiled(folder / "main.c", folder, str(folder / "cell.c"))


def done(program: Path, way: str, capfd: pytest.CaptureFixture[str]) -> tuple[Trace, list[str]]:
    """What the program has done with its arm in one of its ways, and the lines it has printed."""
    status, (trace,) = offline(lambda: run_executable(program, (way,)))
    captured = capfd.readouterr()
    assert (status, captured.err) == (0, "")
    return trace, captured.out.splitlines()


def test_macros_and_several_files_and_signals_that_interrupt_change_no_setpoint(program: Path, capfd) -> None:
    in_words, said = done(program, "words", capfd)
    assert said[-1] == "goal 0"
    assert len(in_words.setpoints.q) > 50
    by_macros, _ = done(program, "macros", capfd)
    assert [request.name for request in by_macros.requests] == ["goal", "goal"]
    np.testing.assert_array_equal(by_macros.setpoints.q, in_words.setpoints.q)
    interrupted, said = done(program, "interrupted", capfd)
    assert said[0] == "1"
    np.testing.assert_array_equal(interrupted.setpoints.q, in_words.setpoints.q)


@pytest.mark.parametrize(("way", "code"), [("ended", 7), ("selects", 9)])
def test_a_handler_and_what_select_finds_end_the_motion_of_that_instant(way, code, program: Path, capfd) -> None:
    trace, said = done(program, way, capfd)
    assert said[0] == str(code)
    assert trace.requests[0].code == code
    assert said[-1] == "slow 1"
    begun, ended = trace.requests[0].begun_s, trace.requests[0].ended_s
    assert begun is not None
    assert ended is not None
    assert 0.0 < ended - begun < 1.0


SHARING = r"""
#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

static int behind[3000], before[3000] = {1}; /* neighbours of the variables of rccl.h */
static int cut;

static void on_user(int number) { nextmove = 42; }

int ftruncate(int file, off_t size) /* a signal comes just then, once */
{
    if (!cut++) {
        errno = EINTR;
        return -1;
    }
    return syscall(SYS_ftruncate, file, size);
}

void *mmap(void *where, size_t size, int protection, int flags, int file, off_t place)
{
    if (flags & MAP_FIXED) /* as the variables move into shared memory */
        raise(SIGUSR1);
    return (void *) syscall(SYS_mmap, where, size, protection, flags, file, place);
}

int main()
{
    signal(SIGUSR1, on_user);
    newtrans("any", const);
    if (nextmove != 42)
        return 3;
    if (!fork()) {
        for (int i = 0; i < 3000; i++)
            behind[i]++, before[i]++;
        _exit(0);
    }
    wait(0);
    for (int i = 0; i < 3000; i++)
        if (behind[i] || before[i] != (i == 0))
            return 4;
    return cut == 2 ? 0 : 5;
}
"""


def test_variables_are_shared_whole_whatever_interrupts_and_no_neighbour_with_them(tmp_path: Path) -> None:
    """What a handler writes meanwhile is kept, and a child of the program has its own copy of all other variables."""
    status, _ = offline(lambda: run_executable(compiled_text(SHARING, tmp_path)))
    assert status == 0
