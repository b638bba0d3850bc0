"""`python -m qrobot.rci.hosts lab2.toml`: offer this host as a processor of RCI, to one program after the other.

Each program finds a process that has run no other: when one is over, the process replaces itself.
"""

from __future__ import annotations

import os
import sys
from functools import partial
from pathlib import Path

from qrobot.errors import QRobotError
from qrobot.rci.hosts.host_server import HostServer
from qrobot.rci.hosts.settings import load_host_settings
from qrobot.report import QueuedReport


def main(arguments: list[str]) -> int:
    """Serve one program. Returns the exit status; 0 when the next may come."""
    if len(arguments) != 1:
        print("usage: python -m qrobot.rci.hosts FILE.toml", file=sys.stderr)
        return 2
    try:
        with QueuedReport(partial(print, flush=True)) as told:
            HostServer(load_host_settings(Path(arguments[0])), told).run()
    except QRobotError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    status = main(sys.argv[1:])
    if status == 0:
        os.execv(sys.executable, [sys.executable, "-m", "qrobot.rci.hosts", *sys.argv[1:]])
    os._exit(status)  # the thread of a task that never comes back would keep us
