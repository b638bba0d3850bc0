"""Intervals and offsets of `rci_onclock` and `rci_trigger` in C, to the largest numbers there are."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from tests.support.c_programs import CHECKED, compiled, needs_compiler
from tests.support.patience import PATIENCE_S

LAST = 40
LARGEST, SMALLEST = (1 << 63) - 1, -(1 << 63)
TEXT = """
#include "rci.h"
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
static RCI_TASK *a, *b, *arm;
static int calls, real;
static void rest(RCI_TASK *td) { (void) td; }
static void call(RCI_TASK *td) { (void) td; calls++; }
static int over(void) { return real ? rci_runs(b) > 20 : rci_ticks() >= 40; }
int main(int n, char **words)
{
    long interval = atol(words[1]), offset = atol(words[2]);
    real = n > 3;
    if ((a = rci_create("a", "")) == 0 || (b = rci_create("b", "")) == 0 || (arm = rci_create("puma560", "")) == 0)
        return 1;
    if (rci_onclock(arm, LONG_MAX, offset) == 0 || rci_onclock(arm, LONG_MIN, offset) == 0)
        return 2;
    if (rci_onclock(a, LONG_MIN, 0) == 0 || rci_trigger(a, LONG_MIN, 0, call) == 0)
        return 3;
    rci_control(a, rest, 0, 0), rci_control(b, rest, 0, 0);
    rci_onclock(a, interval, offset), rci_trigger(a, interval, offset, call), rci_onclock(b, 1, LONG_MIN);
    if (rci_start(a->bit | b->bit) || rci_onclock(a, interval, offset) || rci_wait(over))
        return 4;
    printf("%ld %d\\n", rci_runs(a), calls);
    return rci_close();
}
"""
pytestmark = [needs_compiler, pytest.mark.usefixtures("own_cache")]
NUMBERS = [
    (interval, offset)
    for interval in (1, 3, LARGEST // 2 + 3, LARGEST - 1, LARGEST)
    for offset in (0, 7, -7, LARGEST, LARGEST - 5, SMALLEST, SMALLEST + 5)
]


@pytest.fixture(scope="module")
def program(own_cache: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ticks")
    (source := folder / "far_ticks.c").write_text(TEXT)
    return compiled(source, folder, *CHECKED)


def said(program: Path, *words: object, **environment: str) -> list[int]:
    done = subprocess.run(
        [program, *map(str, words)],
        env=os.environ | {"UBSAN_OPTIONS": "halt_on_error=1"} | environment,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return [int(word) for word in done.stdout.split()]


def test_a_task_and_a_trigger_are_due_by_the_law_of_the_papers_however_large_the_numbers_are(program: Path) -> None:
    for interval, offset in NUMBERS:
        due = sum((tick - offset) % interval == 0 for tick in range(LAST + 1))
        assert said(program, interval, offset, QROBOT_RCI_TIME="virtual") == [due, due], (interval, offset)


@pytest.mark.thorough
@pytest.mark.realtime
def test_in_real_time_what_is_due_in_centuries_delays_no_other_task(program: Path) -> None:
    for interval, offset in ((LARGEST, -1), (LARGEST // 2, LARGEST // 2 - 1)):
        assert said(program, interval, offset, "real") == [0, 0]
