"""Commands that start further processes of this project."""

from __future__ import annotations

import sys


def own_command(module: str, *words: str) -> list[str]:
    """Command that runs a module of this project with `words` behind it.

    Python does not look into the current folder: it would take a user's module `signal` there for the library's, and
    run it in a process of the robot. (Processes that `multiprocessing` spawns, for tasks of RCI and studies, do look
    there: a task's module may be in it.)
    """
    return [sys.executable, "-P", "-m", module, *words]
