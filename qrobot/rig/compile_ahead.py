"""Half of what a first program needs, compiled by a second process while the first one compiles the other half.

`python -m qrobot.rig.compile_ahead ROBOT` fills the cache on disk and ends. Both processes go through the parts of a
cycle, the largest first, and leave out those that the other one has at hand. Before, while the first process compiles
what it makes its board with, and afterwards, while that compiles the rest of its loop, the second one takes what a
program moves by. Whoever needs a kernel that is just being compiled waits for it (`realtime.compile_once`).
"""

from __future__ import annotations

import inspect
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

from numba import typeof, types

from qrobot.config import load_robot
from qrobot.motion.path.path_piece import evaluate
from qrobot.rccl.connect import compile_joint_motion, compile_motion
from qrobot.realtime.compile_once import is_compiled_elsewhere
from qrobot.realtime.jit import jit_disabled
from qrobot.realtime.own_process import own_command
from qrobot.realtime.whole_program import announce
from qrobot.rig.lockstep import LockstepRig, run_blocks
from qrobot.servo.cycle import update_reference
from qrobot.servo.protection import check_inputs
from qrobot.servo.settings import ServoSettings
from qrobot.servo.stages.inputs import read
from qrobot.servo.stages.mode_machine import handle_requests
from qrobot.servo.stages.torque_output import drive, write
from qrobot.sim_board.board import accept_operations, take_sample
from qrobot.sim_board.injection import apply_faults

# Of servo and emulated board, the one that takes longest first: what `part_kernel` marks.
PARTS: Final[tuple[Any, ...]] = (
    update_reference, check_inputs, read, drive, handle_requests,
    accept_operations, write, take_sample, apply_faults,
)  # fmt: skip


def is_compiled() -> bool:
    """True when the cache has the parts and a kernel that every motion needs, or is not asked."""
    return jit_disabled() or all(map(_in_cache, (*PARTS, evaluate)))


def _in_cache(kernel: Any) -> bool:
    """True as well where nothing can be kept."""
    files = getattr(kernel._cache, "_cache_file", None)
    return files is None or not files.is_empty


@contextmanager
def compiled_beside(robot: str) -> Iterator[Callable[[LockstepRig], None]]:
    """Let another process compile within the block; it ends with the block at the latest.

    Yields a function that compiles the loop of a rig, or loads it.
    """
    if is_compiled():
        yield LockstepRig.compile
        return
    quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    command = own_command("qrobot.rig.compile_ahead", robot)
    with subprocess.Popen(command, **quiet) as process:  # type: ignore[call-overload]
        try:
            yield compile_loop
        finally:
            process.kill()  # the cache is written whole or not at all, and locks go with the process


def compile_loop(rig: LockstepRig) -> None:
    """Compile the loop of `rig`: parts first, besides those that another process compiles, then what is left."""
    announce(run_blocks)
    _compile_parts(rig)
    rig.compile()


def compile_parts(robot: str) -> None:
    """Compile the parts of a cycle that nobody else compiles. Raises ConfigError when there is no such robot."""
    _compile_parts(LockstepRig(load_robot(robot), ServoSettings()))


def _compile_parts(rig: LockstepRig) -> None:
    known = argument_types(rig)
    for part in PARTS:
        if not is_compiled_elsewhere(part):
            part.compile(tuple(known[name] for name in inspect.signature(part.py_func).parameters))


def argument_types(rig: LockstepRig) -> dict[str, Any]:
    """Numba's types of what the parts are handed, by the names of their arguments."""
    loop: Any = run_blocks
    by_name = dict(zip(inspect.signature(loop.py_func).parameters, rig.loop_arguments, strict=False))
    known = {name: _type_in_kernel(by_name[name]) for name in ("params", "state", "mail")}
    emulated = {name: _type_in_kernel(getattr(by_name["emulator"], name)) for name in ("board", "shaft")}
    times = dict.fromkeys(("now_ns", "t_ns"), types.int64)
    return {**known, **emulated, **times, "memory": _type_in_kernel(by_name["board"])}


def _type_in_kernel(value: Any) -> Any:
    """Type of a block in kernels: of its record, which the loop takes out of it."""
    found = typeof(value)
    return found.dtype if isinstance(getattr(found, "dtype", None), types.Record) else found


if __name__ == "__main__":
    compile_joint_motion(sys.argv[1])
    compile_parts(sys.argv[1])
    compile_motion(sys.argv[1])
