"""Functions of a C program that the engine calls: each call runs once, in shared memory or by a message."""

from __future__ import annotations

import os
import threading
from collections import Counter
from pathlib import Path

import pytest

from qrobot.c_transport import callback_slot, engine
from qrobot.c_transport.message import Op
from qrobot.rccl.c.program import run_executable
from qrobot.realtime.setup import favoured_thread
from tests.support.c_programs import compiled_text, needs_compiler, offline, ran

pytestmark = [needs_compiler, pytest.mark.usefixtures("own_cache")]

TEXT = """
    #include <unistd.h>
    int quick, slow, asked;
    TRSF_PTR turned;

    is_quick() { quick++; }
    takes_long() { slow++; usleep(300); }
    asks() { asked++; rot(turned, yunit, asked); }

    main()
    {
        turned = gentr_rot("TURNED", 0., 0., 0., yunit, 0.);
        control(is_quick, takes_long);
        setime(100., 2000.);
        evalfn(asks);
        move(jposition("P", 40., -90., 180., 0., 0., 0.));
        waitfor(completed)
        release("done");
        printf("%d %d %d\\n", quick, slow, asked);
        return 0;
    }
"""

THREADS = """
    #include <pthread.h>
    pthread_barrier_t together;
    TRSF_PTR made[8];

    void *first(void *place)
    {
        char name[8];
        snprintf(name, sizeof name, "T%d", (int) ((TRSF_PTR *) place - made));
        pthread_barrier_wait(&together);
        *(TRSF_PTR *) place = gentr_trsl(name, 100., 200., 300.);
        return NULL;
    }

    main()
    {
        pthread_t threads[8];
        int i;
        pthread_barrier_init(&together, NULL, 8);
        for (i = 0; i < 8; i++)
            pthread_create(&threads[i], NULL, first, &made[i]);
        for (i = 0; i < 8; i++)
            pthread_join(threads[i], NULL);
        for (i = 0; i < 8; i++)
            printf("%s %.0f\\n", made[i]->name, made[i]->p.x + made[i]->p.y + made[i]->p.z);
        return 0;
    }
"""

NESTED = """
    TRSF_PTR tool, turned, table;
    POS_PTR goal;
    int turns_called, samples;

    turns() { turns_called++; }
    each() { if (++samples == 5) update(table, goal); }

    main()
    {
        tool = gentr_trsl("TOOL", 0., 0., 100.);
        turned = newtrans("TURNED", turns);
        table = gentr_trsl("TABLE", 0., 400., 200.);
        goal = makeposition("GOAL", t6, tool, EQ, table, turned, TL, tool);
        control(each);
        setime(100., 1000.);
        move(jposition("P", 40., -90., 180., 0., 0., 0.));
        waitfor(completed)
        release("done");
        printf("%d %d\\n", turns_called, samples);
        return 0;
    }
"""

FAVOURED = """
    #define _GNU_SOURCE
    #include <sys/resource.h>
    #include <unistd.h>
    int niceness;

    look() { niceness = getpriority(PRIO_PROCESS, gettid()); }

    main()
    {
        control(look);
        setime(100., 1000.);
        move(jposition("P", 40., -90., 180., 0., 0., 0.));
        waitfor(completed)
        release("done");
        printf("%d %d\\n", niceness, getpriority(PRIO_PROCESS, gettid()));
        return 0;
    }
"""


@pytest.fixture(scope="module")
def folder(own_cache: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("calls")


@pytest.fixture(scope="module")
def program(folder: Path) -> Path:
    return compiled_text(TEXT, folder)


@pytest.fixture(scope="module")
def nested(folder: Path) -> Path:
    return compiled_text(NESTED, folder, name="nested")


def counts(program: Path, monkeypatch: pytest.MonkeyPatch, capfd) -> tuple[list[int], list[int]]:
    """How often the engine has called each function, and how often each was run."""
    called: Counter[int] = Counter()

    class Counting(engine.Background):
        def call(self, op: Op, place: int) -> None:
            if op in (Op.CALL_FUNCTION, Op.CALL_TRANSFORM):
                called[place] += 1
            super().call(op, place)

    monkeypatch.setattr(engine, "Background", Counting)
    status, _ = offline(lambda: run_executable(program))
    assert status == 0
    ran = capfd.readouterr().out.splitlines()[-1].split()
    return sorted(called.values()), sorted(map(int, ran))


def test_however_long_a_function_takes_each_call_runs_it_once(program: Path, monkeypatch, capfd) -> None:
    called, ran = counts(program, monkeypatch, capfd)
    assert called == ran
    assert len(ran) == 3
    assert ran[0] > 50


def test_calls_by_messages_alone_run_once_as_well(program: Path, monkeypatch, capfd) -> None:
    monkeypatch.setattr(callback_slot, "jit_disabled", lambda: True)
    called, ran = counts(program, monkeypatch, capfd)
    assert called == ran
    assert ran[0] > 50


def test_calls_run_once_when_their_numbers_have_come_round(program: Path, monkeypatch, capfd) -> None:
    monkeypatch.setattr(callback_slot, "_NUMBERS", 2)  # takes_long has that of asks
    called, ran = counts(program, monkeypatch, capfd)
    assert called == ran
    assert ran[0] > 50


@pytest.mark.parametrize("by_messages_alone", [False, True])
def test_a_function_may_ask_what_takes_another_function(by_messages_alone, nested: Path, monkeypatch, capfd) -> None:
    monkeypatch.setattr(callback_slot, "jit_disabled", lambda: by_messages_alone)
    called, ran = counts(nested, monkeypatch, capfd)
    assert called == ran
    assert ran[0] > 0


def test_the_thread_of_these_functions_is_favoured_where_that_is_allowed(folder: Path, capfd) -> None:
    own = os.getpriority(os.PRIO_PROCESS, 0)
    with favoured_thread():
        allowed = os.getpriority(os.PRIO_PROCESS, threading.get_native_id())
    status, _ = offline(lambda: run_executable(compiled_text(FAVOURED, folder, name="favoured")))
    assert status == 0
    assert capfd.readouterr().out.splitlines()[-1] == f"{allowed} {own}"


@pytest.mark.parametrize("waits", [True, False], ids=["engine that waits", "engine of its own"])
def test_threads_whose_first_calls_overlap_wait_for_the_engine(
    waits: bool, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    program = compiled_text(THREADS, tmp_path, "-pthread")
    if waits:
        status, _ = offline(lambda: run_executable(program))
        out = capfd.readouterr().out
    else:
        status, out, _ = ran(program)
    assert status == 0
    assert out.splitlines() == [f"T{number} 600" for number in range(8)]
