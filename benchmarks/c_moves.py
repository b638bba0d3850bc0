"""So many moves of one program in C, off line, and what program and engine hold meanwhile: nothing may grow.

    python -m benchmarks c-moves --moves 100000

Each move makes a transform and a position and frees them. Memory, blocks of the interpreter, descriptors and mappings
are looked at again and again; what counts is the second half of the run, when every cache has what it will have. Blocks
of the interpreter are few and come in caches of everybody: of them the growth counts that is there at every look.
"""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from pathlib import Path
from time import perf_counter
from typing import Any, Final

from benchmarks.ctwin import SOURCES
from qrobot import rccl
from qrobot.cli import toolchain
from qrobot.rccl.c.program import run_executable
from qrobot.rccl.offline import OfflineLink
from qrobot.wire import Command, Hello, State

LOOKS: Final = 8  # about so many in a run
SAMPLES_PER_MOVE: Final = 8  # about
MEMORY_BOUND: Final = 2 << 20  # bytes of growth of either process in the second half
BLOCKS_PER_MOVE: Final = 0.2  # at each look; far less than one object for every move
BLOCKS_PER_LOOK: Final = 20  # NumPy's caches of small arrays had 10 more each time, however many moves (2026-11-30)


@dataclass(frozen=True)
class Held:
    """What the two processes hold at one moment.

    Attributes:
        samples: that have passed.
        engine_bytes, program_bytes: resident.
        blocks: that the interpreter of the engine has allocated, less what the looks before have to remember.
        descriptors, mappings: open files, and areas of memory, shared ones included: of the engine and the program.
    """

    samples: int
    engine_bytes: int
    program_bytes: int
    blocks: int
    descriptors: tuple[int, int]
    mappings: tuple[int, int]


@dataclass
class Moves:
    """What came of a run.

    Attributes:
        moves: asked for.
        status: of the program.
        held: from the beginning to the end.
        wall_s: duration.
    """

    moves: int
    status: int = -1
    held: list[Held] = field(default_factory=list)
    wall_s: float = 0.0

    @property
    def failures(self) -> list[str]:
        """What did not hold, in words."""
        if self.status != 0 or len(self.held) < LOOKS // 2:
            return [f"the program ended with status {self.status} after {len(self.held)} looks"]
        later = self.held[len(self.held) // 2 :]
        half, end = later[0], later[-1]
        looks = len(later) - 1
        blocks = looks * min(after.blocks - before.blocks for before, after in pairwise(later))
        grown = {
            "memory of the engine": (end.engine_bytes - half.engine_bytes, MEMORY_BOUND),
            "memory of the program": (end.program_bytes - half.program_bytes, MEMORY_BOUND),
            "blocks of the engine": (blocks, BLOCKS_PER_MOVE * self.moves / 2 + BLOCKS_PER_LOOK * looks),
            "descriptors": (sum(end.descriptors) - sum(half.descriptors), 0),
            "mappings of the program": (end.mappings[1] - half.mappings[1], 0),
        }
        return [f"{what} grew by {by:.0f}" for what, (by, bound) in grown.items() if by > bound]

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return asdict(self) | {"failures": self.failures}


class WatchedLink(OfflineLink):
    """An ideal arm that looks, every so many samples, at what is held."""

    def __init__(self, hello: Hello, every: int, look: Callable[[int], object]) -> None:
        super().__init__(hello)
        self._every, self._look, self._samples = every, look, 0

    def exchange(self, command: Command | None) -> State:
        """As of an ideal arm."""
        self._samples += 1
        if self._samples % self._every == 0:
            self._look(self._samples)
        return super().exchange(command)


def c_moves(moves: int, progress: Callable[[Held], object] = lambda _: None) -> Moves:
    """Run so many. Raises ConfigError: no C compiler."""
    result, began_s, remembered = Moves(moves), perf_counter(), 0

    def look(samples: int) -> None:
        nonlocal remembered
        before = _blocks()
        result.held.append(held(samples, before - remembered))
        progress(result.held[-1])
        remembered += _blocks() - before

    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "moves"
        subprocess.run(toolchain.command_line(["-O2", str(SOURCES / "moves.c"), "-o", str(program)]), check=True)
        every = max(1, moves * SAMPLES_PER_MOVE // LOOKS)
        with rccl.use(lambda hello: WatchedLink(hello, every, look)):
            result.status = run_executable(program, [str(moves)])
    result.wall_s = perf_counter() - began_s
    return result


def held(samples: int, blocks: int) -> Held:
    """What this process and its child hold."""
    engine, program = os.getpid(), _child()
    return Held(
        samples=samples,
        engine_bytes=_resident(engine),
        program_bytes=_resident(program),
        blocks=blocks,
        descriptors=(_entries(engine, "fd"), _entries(program, "fd")),
        mappings=(_lines(engine, "maps"), _lines(program, "maps")),
    )


def _blocks() -> int:
    gc.collect()
    return sys.getallocatedblocks()


def _child() -> int:
    """The newest child of this process, whichever thread has started it."""
    lists = Path("/proc/self/task").glob("*/children")
    return max(int(pid) for children in lists for pid in children.read_text().split())


def _resident(pid: int) -> int:
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE")


def _entries(pid: int, name: str) -> int:
    return sum(1 for _ in Path(f"/proc/{pid}/{name}").iterdir())


def _lines(pid: int, name: str) -> int:
    return len(Path(f"/proc/{pid}/{name}").read_text().splitlines())
