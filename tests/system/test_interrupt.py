"""Ctrl-C ends a program that is caught in compiled code, and is the program's own as long as it hears it."""

from __future__ import annotations

import signal
import subprocess
import sys

from tests.support.patience import PATIENCE_S

CAUGHT = """
import numba, numpy
from qrobot.realtime.interrupt import heed_interrupts

@numba.njit(nogil=True)
def spin(x):
    while x[0] == 0.0:
        pass

x = numpy.ones(1)
spin(x)
x[0] = 0.0
with heed_interrupts(0.1):
    print("caught", flush=True)
    spin(x)
"""
HEARD = f"""
import time
from qrobot.realtime.interrupt import heed_interrupts

with heed_interrupts({PATIENCE_S}):
    for _ in range(2):
        try:
            print("working", flush=True)
            while True:
                time.sleep(0.01)  # a signal that comes just before a sleep does not end it
        except KeyboardInterrupt:
            continue
print("done", flush=True)
"""


def interrupted(program: str, times: int) -> tuple[int, str]:
    """Exit status and the rest of what it says of a program that gets SIGINT after each of its first lines."""
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for _ in range(times):
            process.stdout.readline()
            process.send_signal(signal.SIGINT)
        rest, _ = process.communicate(timeout=PATIENCE_S)
        return process.returncode, rest


def test_a_program_caught_in_compiled_code_is_ended() -> None:
    assert interrupted(CAUGHT, 1)[0] in (130, -signal.SIGINT)  # the latter as plain Python


def test_a_program_that_hears_it_is_left_to_end_by_itself() -> None:
    assert interrupted(HEARD, 2) == (0, "done\n")
