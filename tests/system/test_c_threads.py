"""C programs whose threads ask at the same time: none waits for what another one waits for."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from qrobot.modecodes import Mode
from tests.support.arcl import run_c
from tests.support.c_programs import compiled, compiled_text, needs_compiler, ran
from tests.support.faked_c_programs import MOVING, Run, at_rest, rests_on_its_way, robot, run
from tests.support.patience import PATIENCE_S

__all__ = ["robot", "run"]  # the fixtures

pytestmark = [needs_compiler, pytest.mark.usefixtures("own_cache")]

MOTION_MS = 400_000  # longer than any stall, though virtual time passes as fast as it can
THREAD = """
    #include <pthread.h>
    #include <unistd.h>
    #include <stdlib.h>
    volatile int moving, asking;
    void *other(void *unused)
    {
        while (!moving)
            usleep(500);
        asking = 1;
        %s
        return unused;
    }
"""
MOVING_ON = "moving = 1; while (!asking) usleep(500);"
RCCL = f"""
    main()
    {{
        pthread_t thread;
        POS_PTR p;
        pthread_create(&thread, NULL, other, NULL);
        p = jposition("P", 40., -90., 180., 0., 0., 0.);
        setime(100., {MOTION_MS}.);
        move(p);
        waitas(p->scal > .2)
        {MOVING_ON}
        waitfor(completed)
        pthread_join(thread, NULL);
        return 0;
    }}
"""


@pytest.mark.parametrize(("asks", "status"), [("stop(0.);", 0), ("exit(3);", 3)])
def test_a_thread_gets_its_turn_while_another_one_waits_for_its_arm(asks, status, run: Run, robot) -> None:
    """Who waits asks at each sample."""
    assert run(THREAD % asks + RCCL) == status
    assert rests_on_its_way(robot)


@pytest.mark.usefixtures("arcl_alone")
@pytest.mark.parametrize(
    ("wait", "asks"),
    [
        ("arcl_wait(rp);", "stop(rp);"),
        ("sem_pend(s);", "sem_give(s);"),
        ("arcl_wait(rp, is_given);", "sem_give(s);"),
        ("arcl_wait(rp);", "exit(3);"),
    ],
)
def test_a_wait_of_arcl_gives_way_to_what_another_thread_asks(wait, asks, tmp_path: Path, capfd) -> None:
    text = f"""
    #include <arcl.h>
    #include <stdio.h>
    static ROBOT *rp;
    static Semaphore *s;
    static int is_given(void) {{ return sem_take(s) == OK; }}
    {THREAD % asks}
    static void tell(void) {{ printf("ended\\n"); }}
    int main(void)
    {{
        pthread_t thread;
        atexit(tell);
        pthread_create(&thread, NULL, other, NULL);
        s = new_sem("GO");
        sem_clear(s);
        rp = arcl_open(0);
        move(rp, joint_pos(rp, "P", 40., 90., -90., 0., 90., 0.), MOV_TIME, {MOTION_MS}, 0);
        {MOVING_ON}
        {wait}
        pthread_join(thread, NULL);
        printf("%s\\n", ami_treal(rp) < {MOTION_MS / 2} ? "on its way" : "too late");
        stop(rp);
        arcl_wait(rp);
        return 0;
    }}
    """
    source = tmp_path / "waits.c"
    source.write_text(text)
    status = run_c(compiled(source, tmp_path, "-pthread"), tmp_path)
    said = capfd.readouterr().out
    assert status == (3 if "exit" in asks else 0)
    assert "ended\n" in said
    assert said.count("on its way") == (status == 0)


TURNING = """
    TRSF_PTR a, b;
    volatile event late;
    int samples;
    each() { trmult(b, a, a); if (++samples == 100) late++; }
"""


def test_two_threads_wait_at_once_and_functions_of_samples_ask_meanwhile(run: Run, robot) -> None:
    """On virtual time, which passes in waits alone: one that gave way at once to the other would let none pass."""
    text = f"""
    {TURNING}
    {THREAD % "waitfor(late)"}
    main()
    {{
        pthread_t thread;
        a = gentr_trsl("A", 1., 2., 3.);
        b = newtrans("B", varb);
        control(each);
        pthread_create(&thread, NULL, other, NULL);
        setime(100., 4000.);
        move(jposition("P", 40., -90., 180., 0., 0., 0.));
        {MOVING_ON}
        waitfor(completed)
        pthread_join(thread, NULL);
        return b->p.x == 2. ? 0 : 7;
    }}
    """
    assert run(text) == 0
    assert robot.path[-1][0] == pytest.approx(np.radians(40.0))


@pytest.mark.usefixtures("arcl_alone")
@pytest.mark.parametrize("asks", ["arcl_wait(rp, late);", "while (ami_treal(rp) < 500.);"])
def test_two_waits_of_arcl_and_one_beside_a_thread_that_polls_let_samples_pass(asks, tmp_path: Path, capfd) -> None:
    text = f"""
    #include <arcl.h>
    #include <stdio.h>
    static ROBOT *rp;
    static int looks;
    static int late(void) {{ return ++looks > 20; }}
    {THREAD % asks}
    int main(void)
    {{
        pthread_t thread;
        Motion *m;
        rp = arcl_open(0);
        pthread_create(&thread, NULL, other, NULL);
        m = move(rp, joint_pos(rp, "P", 40., 90., -90., 0., 90., 0.), MOV_TIME, 2000, 0);
        {MOVING_ON}
        arcl_wait(rp);
        pthread_join(thread, NULL);
        return m->code == EVENT_DONE ? late() * 0 : 7;
    }}
    """
    source = tmp_path / "two.c"
    source.write_text(text)
    assert run_c(compiled(source, tmp_path, "-pthread"), tmp_path) == 0


def test_a_program_that_ends_well_beside_a_thread_that_waits_takes_its_arm_once(run: Run, robot) -> None:
    """The motions that wait are done, and nobody asks behind the last call."""
    text = f"""
    {THREAD % "for (;;) suspendfg();"}
    main()
    {{
        pthread_t thread;
        pthread_create(&thread, NULL, other, NULL);
        setime(100., 2000.);
        move(jposition("P", 40., -90., 180., 0., 0., 0.));
        {MOVING_ON}
        return 0;
    }}
    """
    assert run(text) == 0
    assert (robot.goodbyes, robot.mode) == (1, Mode.HOLDING)
    assert robot.path[-1][0] == pytest.approx(np.radians(40.0))


@pytest.mark.parametrize("status", [0, 3])
def test_a_thread_that_is_cancelled_may_end_the_program(status: int, run: Run, robot) -> None:
    text = f"""
    #include <pthread.h>
    #include <stdlib.h>
    main() {{ {MOVING} pthread_cancel(pthread_self()); exit({status}); }}
    """
    assert run(text) == status
    assert at_rest(robot)


def test_a_handler_of_exit_that_calls_where_no_engine_could_be_started_ends_soon(tmp_path: Path) -> None:
    text = """
    #include <poll.h>
    #include <stdlib.h>
    #include <unistd.h>
    int poll(struct pollfd *fds, nfds_t n, int ms) { fds->revents = fds->events; return ms ? _exit(9), 0 : (int) n; }
    tidy() { OPEN; }
    main() { atexit(tidy); newtrans("A", varb); return 0; }
    """
    surroundings = os.environ | {"QROBOT_PYTHON": "/nowhere/python"}
    done = subprocess.run(
        [compiled_text(text, tmp_path)],
        check=False,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        env=surroundings,
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert "name the Python that has qrobot" in done.stderr


def test_a_thread_that_is_cancelled_in_a_call_leaves_its_turn_to_the_others(run: Run, robot) -> None:
    text = f"""
    #include <pthread.h>
    #include <unistd.h>
    volatile int moving;
    POS_PTR p;
    void *waits(void *unused)
    {{
        waitas(p->scal > .2)
        moving = 1;
        waitfor(completed)
        return unused;
    }}
    main()
    {{
        pthread_t thread;
        void *left;
        p = jposition("P", 40., -90., 180., 0., 0., 0.);
        setime(100., {MOTION_MS}.);
        move(p);
        pthread_create(&thread, NULL, waits, NULL);
        while (!moving)
            usleep(500);
        pthread_cancel(thread);
        pthread_join(thread, &left);
        stop(0.);
        waitfor(completed)
        return left == PTHREAD_CANCELED ? 0 : 7;
    }}
    """
    assert run(text) == 0
    assert rests_on_its_way(robot)


def test_a_pipe_that_a_program_has_opened_before_its_first_call_ends_when_it_closes_it(tmp_path: Path) -> None:
    """Its engine must not hold the other end: `pclose` would wait for the end of the program."""
    text = """
    main() {
        FILE *pipe = popen("cat >/dev/null", "w");
        newtrans("A", varb);
        return pclose(pipe);
    }
    """
    assert ran(compiled_text(text, tmp_path)) == (0, "", "")


def test_what_a_child_of_a_program_sets_stays_with_the_child(run: Run, robot) -> None:
    text = """
    #include <sys/wait.h>
    #include <unistd.h>
    main() {
        int status;
        TRSF_PTR a = gentr_trsl("A", 1., 2., 3.);
        if (!fork()) {
            if (a->p.x != 1. || nextmove != 0)
                _exit(8);
            a->p.x = 7.;
            nextmove = 5;
            terminate = 1;
            _exit(a->p.x == 7. && terminate == 1 ? 0 : 9);
        }
        wait(&status);
        gentr_trsl("B", 1., 2., 3.);
        return a->p.x == 1. && nextmove == 0 && terminate == 0 ? WEXITSTATUS(status) : 7;
    }
    """
    assert run(text) == 0


BEHIND = """
    #include <pthread.h>
    #include <signal.h>
    #include <unistd.h>
    __attribute__((destructor)) static void behind(void) { OPEN; }
"""


def test_what_asks_behind_the_end_is_told_that_nothing_can_be_asked(run: Run, robot, capfd) -> None:
    """No handler, and no destructor, waits for a turn that nobody has any more."""
    assert run(f"{BEHIND}\nmain() {{ {MOVING} return 0; }}") == 1
    assert at_rest(robot)
    assert "program: nothing can be asked any more" in capfd.readouterr().err


def test_a_handler_that_asks_while_the_end_waits_for_its_turn_ends_the_program(run: Run, robot, capfd) -> None:
    text = f"""
    {BEHIND.replace("OPEN;", "")}
    volatile int asking;
    void asks(int number) {{ (void) number; OPEN; }}
    void *other(void *unused) {{ asking = 1; for (;;) suspendfg(); return unused; }}
    pthread_t self;
    void *kills(void *unused) {{ for (;;) {{ pthread_kill(self, SIGUSR1); usleep(1000); }} return unused; }}
    main()
    {{
        pthread_t threads[2];
        self = pthread_self();
        {MOVING}
        signal(SIGUSR1, asks);
        pthread_create(&threads[0], NULL, other, NULL);
        while (!asking)
            usleep(1000);
        pthread_create(&threads[1], NULL, kills, NULL);
        return 0;
    }}
    """
    assert run(text) == 1
    assert at_rest(robot)
    assert re.search("must not call|nothing can be asked", capfd.readouterr().err)
