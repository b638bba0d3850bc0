"""Runs a command with what others leave of the processors: `python -m tests.support.idle COMMAND ...`.

The idle policy alone holds within one session: where the kernel shares the processors out among sessions (autogroups),
one of idle threads gets as much as the servo of an arm, whose processes have sessions of their own. So the command gets
a session too, and that one gets little. What ends this process is passed on to it.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from qrobot.realtime.signals import SIGNALLED

LITTLE: Final = 10  # [A] the session's niceness: a tenth of what another one gets that wants a processor as well


_PR_SET_PDEATHSIG: Final = 1  # linux/prctl.h


def _stand_back() -> None:
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)  # where this process cannot pass anything on
    with suppress(OSError):  # a kernel without autogroups
        Path("/proc/self/autogroup").write_text(str(LITTLE))
    try:
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    except OSError:
        os.nice(19)


def run(command: Sequence[str]) -> int:
    """Run it; its exit status, as shells have it."""
    with subprocess.Popen(command, start_new_session=True, preexec_fn=_stand_back) as child:  # noqa: PLW1509

        def pass_on(number: int, _frame: object) -> None:
            with suppress(ProcessLookupError):
                os.killpg(child.pid, number)

        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, pass_on)
        status = child.wait()
    return status if status >= 0 else SIGNALLED - status


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:]))
