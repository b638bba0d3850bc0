"""Second process that compiles a program's motion kernels while the first one compiles servo and board.

`python -m qrobot.rig.compile_ahead ROBOT` fills the cache on disk and ends. Whoever needs a kernel that it is just
compiling waits for it (`realtime.compile_once`).
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from qrobot.motion.path.path_piece import evaluate
from qrobot.rccl.connect import compile_motion
from qrobot.realtime.jit import jit_disabled


def is_compiled() -> bool:
    """True when the cache has a kernel that every motion needs, or is not asked."""
    kernel: Any = evaluate
    return jit_disabled() or not hasattr(kernel, "_cache") or bool(kernel._cache._cache_file._load_index())


@contextmanager
def motion_compiled_beside(robot: str) -> Iterator[None]:
    """Let another process compile within the block; it ends with the block at the latest."""
    if is_compiled():
        yield
        return
    quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    command = [sys.executable, "-m", "qrobot.rig.compile_ahead", robot]
    with subprocess.Popen(command, **quiet) as process:  # type: ignore[call-overload]
        try:
            yield
        finally:
            process.kill()  # the cache is written whole or not at all, and locks go with the process


if __name__ == "__main__":
    compile_motion(sys.argv[1])
