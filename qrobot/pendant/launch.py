"""Becomes a command that does not outlive the thread which started it; run by its path: PARENT NICENESS COMMAND ...

SIGINT is what the command gets when that thread ends, as at a terminal; a robot program then brings its arm to rest.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1  # linux/prctl.h; kept by exec


def main(parent: str, niceness: str, *command: str) -> None:
    """Replace this process by the command."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # a shell has it ignored for what runs in the background
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGINT, 0, 0, 0)
    if os.getppid() != int(parent):
        sys.exit("who started this has gone")
    os.nice(int(niceness))
    os.execv(command[0], command)


if __name__ == "__main__":
    main(*sys.argv[1:])
