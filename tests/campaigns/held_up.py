"""A servo that is held up alone, again and again, while the board goes on: what it is told as, by length.

Random moves as in `quiet`, at random instants a pause of the servo with the torque it had; frames go on arriving. The
arm truly leaves its path meanwhile, and is brought back: nothing is broken, and nothing may be named that is not.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from qrobot.faultcodes import FaultCode
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.memory.stop_record import read_incident
from qrobot.servo.settings import Overrun
from qrobot.sim_board.emulator import emulator_run
from tests.campaigns.quiet import path
from tests.support.campaign import FRAME_NS, N
from tests.support.dead_encoder import Case, SlowArm

STALLS_MS = (5, 10, 15, 20, 25, 30, 40, 60)
RUN_S = 20.0
# It has left its path, and takes all the torque there is to come back; the stream began to be old.
HONEST = (FaultCode.FOLLOWING, FaultCode.SATURATED, FaultCode.STREAM_LOST)
COUNTED = Overrun(misses_in_a_row=0, late_share=1.0)  # late cycles of an emulated arm are only counted


class HeldUpArm(SlowArm):
    """Follows a path while its servo is held up."""

    def follow(self, q: np.ndarray, stall_ms: int, every: int, random: np.random.Generator) -> None:
        """Send row after row of `q`; about one frame in `every` the servo is held up somewhere in it."""
        began_ns = self.rig.now_ns
        for frame, row in enumerate(q):
            due_ns = began_ns + frame * FRAME_NS
            self._to(due_ns)
            self.rig.mailbox.push_setpoint(1, frame, due_ns, FRAME_NS, [POSITION_SETPOINT] * N, row.tolist())
            if random.integers(every) == 0:
                self._to(due_ns + int(random.integers(FRAME_NS)))
                self._stall(stall_ms * 1_000_000)
            if read_incident(self.rig.state.watch.incident) is not None:
                return

    def _to(self, instant_ns: int) -> None:
        if instant_ns > self.rig.now_ns:
            self.rig.ticks((instant_ns - self.rig.now_ns) // self.rig.period_ns)

    def _stall(self, stall_ns: int) -> None:
        rig = self.rig
        rig.now_ns = emulator_run(rig.emulator.bundle, rig.board, rig.now_ns, stall_ns // rig.emulator.bundle.period_ns)


def told_as(stall_ms: int, draw: int, seconds: float = RUN_S) -> FaultCode:
    """Run a stretch; the code that stopped the arm, NONE when nothing did."""
    random = np.random.default_rng((draw, stall_ms))
    arm = HeldUpArm(Case(1, 0.0, False, True, draw=draw), 1000.0, overrun=COUNTED)
    arm.follow(path(random, arm.start, seconds), stall_ms, 20, random)
    incident = read_incident(arm.rig.state.watch.incident)
    return FaultCode.NONE if incident is None else FaultCode(incident.code)


def campaign(draws: int) -> int:
    """Run it; the number of stretches that were stopped for a reason that was none."""
    wrong = 0
    for stall_ms in STALLS_MS:
        told = Counter(told_as(stall_ms, draw) for draw in range(draws))
        wrong += sum(n for code, n in told.items() if code != FaultCode.NONE and code not in HONEST)
        table = ", ".join(f"{n} x {'nothing' if code == FaultCode.NONE else code.name}" for code, n in told.items())
        print(f"held up for {stall_ms} ms: {table}", flush=True)
    print(f"{wrong} of {draws * len(STALLS_MS)} stretches were stopped for what had not happened", flush=True)
    return wrong
