"""An arm in motion beside programs that compute all the time.

    python -m benchmarks busy FILE --minutes 10

An ordinary program that never waits runs on each processor, while a program swings the emulated arm between two poses.
Nothing comes of it, unless the machine keeps the servo alone from running for longer than its guardian allows.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.stalls import Swings, slipped_s, snapshot_of, swinging
from qrobot.config.deployment import load_deployment
from qrobot.rig.deployed import ArmProcesses
from qrobot.rig.processes import ProcessRig
from qrobot.servo.memory.published_state import ServoSnapshot

LOOK_S: Final = 0.1
START_S: Final = 5.0  # a program that has not taken the arm by then has failed


@dataclass
class Busy(Swings):
    """What came of it so far.

    Attributes:
        loops: programs that computed beside it. seconds: for how long. late_cycles: of the servo.
    """

    loops: int = 0
    seconds: float = 0.0
    late_cycles: int = 0

    def look(self, now: ServoSnapshot, seconds: float) -> None:
        """Take a look after so many seconds; in the first ones the arm gets its power."""
        self.seconds, self.late_cycles = seconds, now.late_cycles
        self.see(now, f"{seconds:.0f} s", has_power=seconds > START_S)


@contextmanager
def busy_loops(count: int) -> Iterator[None]:
    """So many processes compute meanwhile."""
    with ExitStack() as loops:
        for _ in range(count):
            loop = loops.enter_context(subprocess.Popen([sys.executable, "-c", "while True: pass"]))
            loops.callback(loop.kill)
        yield


def busy(
    deployment: Path,
    folder: Path,
    seconds: float,
    progress: Callable[[Busy], None] = lambda _: None,
    loops: int | None = None,
) -> Busy:
    """Start the one arm of a deployment and swing it for so long; ends with the first event.

    `loops` programs compute meanwhile; left out, one a processor.

    Raises what its processes or its program fail by.
    """
    (arm,) = load_deployment(deployment).arm
    found = Busy(loops=(os.cpu_count() or 1) if loops is None else loops)
    with ProcessRig(folder) as rig:
        ArmProcesses(rig, str(deployment), arm).start_all()
        with busy_loops(found.loops), swinging(arm) as program:
            began_s = time.monotonic()
            while found.seconds < seconds and not found.events:
                time.sleep(LOOK_S)
                found.look(snapshot_of(arm.name), time.monotonic() - began_s)
                if not program.is_alive():
                    found.events.append(f"the program has lost the arm after {found.seconds:.0f} s")
                progress(found)
        found.slipped_s = slipped_s(arm.name)
    return found
