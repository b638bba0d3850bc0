"""Masks of tasks in RCI for programs in C: `RCI_ALL` stands for all of them, in every call that takes one."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from qrobot import rccl, rci
from qrobot.cli import toolchain
from qrobot.modecodes import Mode
from qrobot.rccl.c.program import run_executable
from qrobot.rccl.offline import OfflineLink
from tests.support.c_programs import needs_compiler

pytestmark = [needs_compiler, pytest.mark.usefixtures("own_cache")]

HEADER = Path(rci.__file__).parent / "c/include/rci.h"
PROGRAM = """
#include "rci.h"
#include <stdio.h>
static RCI_TASK *a, *b, *arm;
static unsigned long mask, others;
static long word;

static void turn(RCI_TASK *td)
{
    double q[6];
    int j;
    for (j = 0; j < 6; j++) q[j] = td->how.q_setpoint[j] + (j == 0 ? 0.001 : 0.0);
    rci_goto(td, q);
}
static long heard(void)
{
    long got, count = 0;
    RCI_TASK *sender;
    while (rci_receive(mask, &got, sizeof got, &sender) > 0)
        count++;
    return count;
}
static void tell(RCI_TASK *td)
{
    static int told;
    long sent;
    (void)td;
    if (told++ > 0)
        return;
    sent = rci_send(others, &word, sizeof word);
    printf("rci_send %ld, own %ld\\n", sent, heard());
}
static void hear(RCI_TASK *td)
{
    long count = heard();
    (void)td;
    if (count)
        printf("b hears %ld\\n", count);
}
static int over(void) { return rci_runs(arm) > 3 && rci_runs(b) > 3; }
static void say(const char *call, int got)
{
    RCI_HOW how;
    rci_how(arm, &how);
    printf("%s %d: states %d %d %d, mode %d\\n", call, got, rci_state(a), rci_state(b), rci_state(arm), how.mode);
}

int main(int n, char **words)
{
    (void)words;
    if ((a = rci_create("a", "")) == 0 || (b = rci_create("b", "")) == 0 || (arm = rci_create("puma560", "")) == 0)
        return 1;
    rci_control(a, tell, 0, 0), rci_control(b, hear, 0, 0), rci_control(arm, turn, 0, 0);
    rci_onclock(a, 1, 0), rci_onclock(b, 1, 0);
    others = mask = RCI_ALL;
    if (n > 1) {
        mask = RCI_PARENT | a->bit | b->bit | arm->bit;
        others = mask & ~a->bit;
    }
    printf("rci_sharedMemory %d\\n", rci_sharedMemory("m", 8, 0, mask) != 0);
    printf("rci_sharedData %d\\n", rci_sharedData(mask, &word, sizeof word));
    say("rci_start", rci_start(mask));
    if (rci_state(arm) == RCI_ACTIVE)
        rci_wait(over);
    printf("the program hears %ld\\n", heard());
    say("rci_release", rci_release(mask));
    say("rci_start", rci_start(mask));
    say("rci_powerOff", rci_powerOff(mask));
    return rci_close();
}
"""


@pytest.fixture(scope="module")
def program(own_cache: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("masks") / "program"
    source = target.with_suffix(".c")
    source.write_text(PROGRAM)
    command = toolchain.command_line(["-std=c99", "-Wall", "-Wextra", "-Werror", str(source), "-o", str(target)])
    subprocess.run(command, check=True)
    return target


@pytest.mark.parametrize("words", [[], ["each"]], ids=["RCI_ALL", "each by its bit"])
def test_rci_all_stands_for_the_program_and_all_tasks_in_every_mask(
    words: list[str], program: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with rci.use(OfflineLink), rccl.use(OfflineLink):
        assert run_executable(program, words) == 0
    said = capfd.readouterr()
    active, released = (f"states {3 * f'{state} '}".strip() for state in (3, 5))  # RCI_ACTIVE, RCI_RELEASED
    assert said.err == ""
    assert said.out.splitlines() == [
        "rci_sharedMemory 1",
        "rci_sharedData 0",
        f"rci_start 0: {active}, mode {Mode.TRACKING:d}",
        "rci_send 8, own 0",
        "b hears 1",
        "the program hears 1",
        f"rci_release 0: {released}, mode {Mode.HOLDING:d}",
        f"rci_start 0: {active}, mode {Mode.TRACKING:d}",
        f"rci_powerOff 0: {released}, mode {Mode.OFF:d}",
    ]


def test_no_call_that_takes_a_mask_is_left_out_here() -> None:
    masks = re.findall(r"(rci_\w+)\([^)]*unsigned long (?:mask|sendcode|getcode|accessMask)\b", HEADER.read_text())
    assert len(masks) == 7
    assert [call for call in masks if not re.search(rf"{call}\([^)]*\b(?:mask|others)\b", PROGRAM)] == []
