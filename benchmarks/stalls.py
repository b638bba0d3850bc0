"""A machine that stands still: all processes of an emulated arm are stopped at once, again and again, in motion.

    python -m benchmarks stalls --times 100

Board, servo, guardian, bridge and log get SIGSTOP together, and SIGCONT some 5 to 500 ms later, while a program swings
the arm between two poses. No hardware goes on meanwhile, so what has to come of it is nothing: no fault, no stop.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from qrobot.config.deployment import DeployedArm, load_deployment
from qrobot.errors import QRobotError
from qrobot.faultcodes import FaultCode
from qrobot.hwif.board_memory import attach_board_memory
from qrobot.modecodes import Mode
from qrobot.rccl.channel import Channel
from qrobot.rccl.connect import open_channel
from qrobot.rci import TcpLink
from qrobot.rig.deployed import ArmProcesses
from qrobot.rig.processes import ProcessRig
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.published_state import ServoSnapshot
from qrobot.servo.memory.servo_memory import attach_servo_memory
from qrobot.units import NS_PER_S

SHORTEST_S, LONGEST_S = 0.005, 0.5
PAUSE_S: Final = (0.1, 0.6)  # between two stalls
SPEED: Final = 1.05  # rad/s: the paper's fast leg
START_S: Final = 5.0
POLL_S: Final = 0.01


def stall(pids: Iterable[int], seconds: float) -> float:
    """Stop these processes at once, and let them go on after so long.

    Returns:
        By how much the last one was stopped, or went on, later than the first, s.
    """
    pids, apart_s = list(pids), 0.0
    for number, pause_s in ((signal.SIGSTOP, seconds), (signal.SIGCONT, 0.0)):
        begin = time.monotonic()
        for pid in pids:
            os.kill(pid, number)
        apart_s = max(apart_s, time.monotonic() - begin)
        time.sleep(pause_s)
    return apart_s


def snapshot_of(arm: str) -> ServoSnapshot:
    """The servo's state now."""
    with attach_servo_memory(arm) as segment:
        return ServoMailbox(segment.words).snapshot()


def slipped_s(arm: str) -> float:
    """How long the arm's time stood still so far."""
    with attach_board_memory(arm) as segment:
        return int(segment.memory.facts.slipped_ns) / NS_PER_S


@dataclass
class Swings:
    """What came of a swinging arm so far.

    Attributes:
        events: what the servo said, and when. missed: frames that were missing.
        slipped_s: what the arm's time stood still. largest_error: reference minus position, rad or m.
    """

    events: list[str] = field(default_factory=list)
    missed: int = 0
    slipped_s: float = 0.0
    largest_error: float = 0.0

    def see(self, now: ServoSnapshot, when: str, has_power: bool = True) -> None:
        """Take a look; an arm that is to have power has to be on its way, or between two of them."""
        self.missed = now.missed_frames
        self.largest_error = max(self.largest_error, float(np.abs(now.q_setpoint - now.q).max()))
        if has_power and (now.event or now.mode not in (Mode.TRACKING, Mode.HOLDING)):
            self.events.append(f"{FaultCode(now.event).name} in {Mode(now.mode).name} after {when}")


@dataclass
class Stalls(Swings):
    """The same of an arm whose processes are stopped.

    Attributes:
        times: stalls so far. stopped_s: how long in all, of which `slipped_s` did not count.
        apart_s: by how much one process was stopped, or went on, later than another of its stall, at most: an arm whose
            servo alone goes on for a while has been disturbed by that.
    """

    times: int = 0
    stopped_s: float = 0.0
    apart_s: float = 0.0

    def look(self, now: ServoSnapshot, seconds: float, apart_s: float) -> None:
        """Take a look after a stall of so many seconds."""
        self.apart_s = max(self.apart_s, apart_s)
        self.times, self.stopped_s = self.times + 1, self.stopped_s + seconds
        self.see(now, f"{1e3 * seconds:.0f} ms")


def swing(channel: Channel, done: threading.Event) -> None:
    """Move back and forth until told otherwise, or until the arm is lost."""
    channel.setjvel(SPEED)
    try:
        while not done.is_set():
            for name in ("end", "park"):
                channel.move(channel.pose(name))
            channel.waitfor(channel.completed)
    except QRobotError:
        return


@contextmanager
def swinging(arm: DeployedArm) -> Iterator[threading.Thread]:
    """A program swings the running arm meanwhile, in a thread that ends when it loses it.

    Raises what connecting fails by.
    """
    link = partial(TcpLink, address=(arm.bridge.host, arm.bridge.port))
    with open_channel(link, arm.robot, arm.bridge.period_ms, clear_fault=True) as channel:
        done = threading.Event()
        program = threading.Thread(target=swing, args=(channel, done))
        program.start()
        try:
            yield program
        finally:
            done.set()
            program.join()


def stall_again_and_again(
    arm: str, pids: Callable[[], list[int]], times: int, seed: int, longest_s: float = LONGEST_S
) -> Stalls:
    """So many stalls of a moving arm, their lengths drawn evenly on a logarithmic scale; ends with the first event."""
    random, found = np.random.default_rng(seed), Stalls()
    for _ in range(times):
        time.sleep(float(random.uniform(*PAUSE_S)))
        seconds = float(np.exp(random.uniform(np.log(SHORTEST_S), np.log(longest_s))))
        apart_s = stall(pids(), seconds)
        time.sleep(2 * POLL_S)
        found.look(snapshot_of(arm), seconds, apart_s)
        if found.events:
            break
    found.slipped_s = slipped_s(arm)
    return found


def stalls(deployment: Path, folder: Path, times: int, seed: int = 0) -> Stalls:
    """Start the one arm of a deployment, swing it, stall it. Raises what its processes or its program fail by."""
    (arm,) = load_deployment(deployment).arm
    with ProcessRig(folder) as rig:
        ArmProcesses(rig, str(deployment), arm).start_all()
        with swinging(arm):
            return stall_again_and_again(
                arm.name, lambda: [child.process.pid for child in rig.children.values()], times, seed
            )
