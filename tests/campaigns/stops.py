"""Stops at random instants of random motions, in every way the path between setpoints may be drawn.

Each trial is a random motion of all joints at up to full speed, whose setpoints come at some period to a servo of some
rate, on the nominal arm or on a mismatched one with a load nobody knows. At a random instant somebody asks for a stop.
It has to end in HOLDING, and nothing else may stop the arm before or afterwards.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.motion import Generator, MoveRequest, SpeedShare, motion_limits
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.memory.stop_record import read_incident
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.mismatch import PlantMismatch
from tests.support.campaign import PUMA, Floats, N

RATES_HZ = (500.0, 1000.0, 2000.0, 4000.0)
PERIODS_S = (0.010, 0.020, 0.028, 0.050, 0.100)
DRAWS = (None, 0, 2, 13)
LOAD_KG = 2.5
SETTLE_S = 0.6


@dataclass(frozen=True)
class Case:
    """One trial. `draw` is of the mismatched plant, None for the nominal one without a load."""

    form: str
    rate_hz: float
    period_s: float
    draw: int | None
    seed: int


def cases(times: int, form: str) -> Iterator[Case]:
    """So many trials, evenly over rates, periods and plants."""
    for k in range(times):
        yield Case(
            form,
            RATES_HZ[k % len(RATES_HZ)],
            PERIODS_S[k // len(RATES_HZ) % len(PERIODS_S)],
            DRAWS[k // (len(RATES_HZ) * len(PERIODS_S)) % len(DRAWS)],
            k,
        )


def motion(random: np.random.Generator, period_s: float) -> Floats:
    """Two random moves, one row a setpoint."""
    generator = Generator(motion_limits(PUMA), period_s, PUMA.poses["ready"])
    rows, tick = [PUMA.poses["ready"]], 0
    for _ in range(2):
        target = random.uniform(PUMA.limits.q_min + 0.05, PUMA.limits.q_max - 0.05)
        generator.push(MoveRequest("random", target, SpeedShare(random.uniform(0.05, 0.95))))
    while True:
        tick += 1
        output = generator.update(tick)
        rows.append(output.q)
        if not output.moving:
            return np.array(rows)


def stop_once(case: Case) -> tuple[Mode, FaultCode]:
    """Mode and code in the end."""
    random = np.random.default_rng(case.seed)
    path = motion(random, case.period_s)
    mismatch = PlantMismatch.nominal(N) if case.draw is None else PlantMismatch.mismatched(N, seed=case.draw)
    load = 0.0 if case.draw is None else LOAD_KG
    plant = Emulator(PUMA, start="ready", physics="rigid", payload_kg=load, mismatch=mismatch)
    settings = ServoSettings(rate_hz=case.rate_hz, interpolation=case.form)
    rig = LockstepRig(PUMA, settings, plant, keep_telemetry=False)
    rig.ticks(3)
    rig.mailbox.request_power(True)
    rig.run_for(0.2)
    share = random.uniform(0.0, 1.0)
    for seq, q in enumerate(path[: 1 + int(random.uniform(0.02, 0.98) * len(path))]):
        modes = [POSITION_SETPOINT] * N
        rig.mailbox.push_setpoint(1, seq, rig.now_ns, round(case.period_s * 1e9), modes, q.tolist())
        rig.run_for(case.period_s)
    rig.run_for(share * case.period_s)
    rig.mailbox.request_stop()
    rig.run_for(SETTLE_S)
    incident = read_incident(rig.state.watch.incident)
    seen = rig.mailbox.snapshot()
    return Mode(seen.mode), FaultCode(seen.event if incident is None else incident.code)


def campaign(times: int, form: str) -> int:
    """Run it; the number of trials that did not end in a stop alone."""
    wrong = 0
    for case in cases(times, form):
        mode, code = stop_once(case)
        if (mode, code) != (Mode.HOLDING, FaultCode.NONE):
            wrong += 1
            print(f"{case}: {mode.name}, {code.name}", flush=True)
    print(f"{times} stops, form {form}: {wrong} were not a stop alone", flush=True)
    return wrong
