"""How soon an arm whose servo is killed on its way has no torque and no power, by the board's own stamps.

    python -m benchmarks guardian FILE --times 20

The time counts from the servo's last heartbeat, so a part of the servo's period is in it. The guardian acts within its
bound and a fifth where the system lets it run; more than twice the bound is told as late.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.stalls import snapshot_of, swinging
from qrobot.config.deployment import DeployedArm, load_deployment
from qrobot.errors import LinkTimeout, QRobotError
from qrobot.hwif.board_memory import BoardMemory, Lane, attach_board_memory
from qrobot.hwif.registers import DISCRETE, N_DACS
from qrobot.hwif.trace import read_trace
from qrobot.realtime.deadline import Deadline, comes_true
from qrobot.rig.deployed import ArmProcesses
from qrobot.rig.processes import ProcessRig
from qrobot.servo.memory.servo_memory import attach_servo_memory
from qrobot.units import NS_PER_MS

RAD_S: Final = 0.5  # on its way
PATIENCE_S, LOOK_S = 20.0, 0.005
PAUSE_S: Final = 0.1  # at most, from there until the servo is killed: at any point of its period


@dataclass
class Reactions:
    """What came of it so far.

    Attributes:
        bound_ms: silence that the guardian allows.
        safe_ms: from the last heartbeat of each servo until the board had taken zero torque and no power.
    """

    bound_ms: float
    safe_ms: list[float] = field(default_factory=list)

    @property
    def late(self) -> int:
        """How often it took longer than twice the bound."""
        return sum(not each <= 2.0 * self.bound_ms for each in self.safe_ms)


def reactions(
    deployment: Path, folder: Path, times: int, seed: int = 0, progress: Callable[[Reactions], None] = lambda _: None
) -> Reactions:
    """Start the one arm of a deployment, and kill its servo so many times on the way.

    Raises what its processes or its program fail by, and LinkTimeout when the arm does not get on its way or to rest.
    """
    (arm,) = load_deployment(deployment).arm
    found, random = Reactions(arm.servo.guardian_patience_ms), np.random.default_rng(seed)
    with ProcessRig(folder) as rig:
        processes = ArmProcesses(rig, str(deployment), arm)
        processes.start_all()
        servo = processes.name_of("servo")
        for so_far in range(1, times + 1):
            with suppress(QRobotError), swinging(arm):  # the program loses its arm
                _wait(lambda: bool(np.abs(snapshot_of(arm.name).v).max() > RAD_S), "is not on its way")
                time.sleep(float(random.uniform(0.0, PAUSE_S)))
                rig.children[servo].process.kill()
                rig.children[servo].process.wait()
                found.safe_ms.append(_safe_after_ms(arm))
            if len(found.safe_ms) < so_far:
                raise LinkTimeout(f"the arm did not get on its way, or was not made safe, within {PATIENCE_S:g} s")
            progress(found)
            processes.start("servo")
            _wait(lambda: bool(np.abs(snapshot_of(arm.name).v).max() < 1e-3), "does not come to rest")
    return found


def _safe_after_ms(arm: DeployedArm) -> float:
    """From the last heartbeat of a servo that is dead until the board has taken what makes it safe."""
    with attach_servo_memory(arm.name) as segment:
        beat_ns = int(segment.front.heartbeat.t_ns)
    with attach_board_memory(arm.name) as board:
        _wait(lambda: _safe_ns(board.memory, beat_ns) > 0, "is not made safe")
        return (_safe_ns(board.memory, beat_ns) - beat_ns) / NS_PER_MS


def _safe_ns(memory: BoardMemory, beat_ns: int) -> int:
    """Time of the last write of the guardian's first list after a heartbeat; 0 while there is none."""
    trace = read_trace(memory)
    by_guardian = trace[(trace[:, 0] > beat_ns) & (trace[:, 1] == Lane.GUARDIAN)][: 1 + N_DACS]
    whole = len(by_guardian) == 1 + N_DACS and by_guardian[0, 2] == DISCRETE
    return int(by_guardian[-1, 0]) if whole else 0


def _wait(condition: Callable[[], bool], otherwise: str) -> None:
    if not comes_true(condition, Deadline(PATIENCE_S), LOOK_S):
        raise LinkTimeout(f"the arm {otherwise} within {PATIENCE_S:g} s")
