"""Programs in C with tasks of RCI whose first calls get no descriptor, or no memory."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.c_programs import compiled_text, needs_compiler, ran

pytestmark = [needs_compiler, pytest.mark.usefixtures("own_cache")]

NO_DESCRIPTOR = """
#include "rci.h"
#include <fcntl.h>
#include <stdio.h>
#include <sys/resource.h>
#include <unistd.h>
int main(void)
{
    const struct rlimit four = {4, 4};
    if (dup2(2, 3) != 3 || close(0) || close(1) || setrlimit(RLIMIT_NOFILE, &four) || rci_create("a", "aux") != 0)
        return 1;
    return fcntl(0, F_GETFD) != -1 || fcntl(1, F_GETFD) != -1;
}
"""
NO_MEMORY = """
#include "rci.h"
#include <errno.h>
#include <stdlib.h>
static int lacks;
void *calloc(size_t count, size_t size)
{
    char *made = lacks ? 0 : (char *) malloc(count * size);
    size_t i;
    if (lacks)
        errno = ENOMEM;
    for (i = 0; made != 0 && i < count * size; i++)
        ((volatile char *) made)[i] = 0;
    return made;
}
int main(void)
{
    RCI_TASK *from;
    long number = 7, got = 0;
    lacks = 1;
    if (rci_clock(100) || rci_create("a", "") != 0)
        return 1;
    lacks = 0;
    if (rci_receive(RCI_ALL, &got, sizeof got, &from) != 0 || from != 0)
        return 2;
    if (rci_send(RCI_PARENT, &number, sizeof number) != sizeof number)
        return 3;
    if (rci_close() || rci_receive(RCI_ALL, &got, sizeof got, &from) != 0)
        return 4;
    return rci_create("a", "") == 0 || rci_close();
}
"""


def test_a_pipe_that_cannot_be_made_is_told_by_its_own_error_and_leaves_nothing_open(tmp_path: Path) -> None:
    status, _, told = ran(compiled_text(NO_DESCRIPTOR, tmp_path))
    assert (status, told) == (0, "rci: rci_create: processor aux: Too many open files\n")


def test_a_program_that_had_no_memory_in_its_first_call_sends_and_receives_later(tmp_path: Path) -> None:
    status, _, told = ran(compiled_text(NO_MEMORY, tmp_path, "-O1", "-fno-builtin"))
    assert status == 0, told
