"""A C program of RCCL with its engine in this process, which says which arm it gets."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from qrobot.c_transport.program import run_served
from qrobot.c_transport.program_link import MakeDispatcher
from qrobot.rccl.c.dispatcher import Dispatcher

ROBOT: Final = "QROBOT_ROBOT"  # environment: rules over whoever starts the program
DEFAULT_ROBOT: Final = "puma560"


def rccl_dispatcher(robot: str = DEFAULT_ROBOT) -> MakeDispatcher:
    """Maker of dispatchers for programs whose arm is a `robot`, a packaged one's name or a file.

    The variable QROBOT_ROBOT may name another.
    """
    return lambda memory, places, link: Dispatcher(memory, list(places), link, os.environ.get(ROBOT) or robot)


def run_executable(path: Path, arguments: Sequence[str] = (), robot: str = DEFAULT_ROBOT) -> int:
    """Run a program of RCCL alone; see `run_served` and `rccl_dispatcher`."""
    return run_served(path, arguments, [rccl_dispatcher(robot)])
