"""An hour of virtual time in which nothing is broken, and nothing may stop the arm.

Random moves of all joints, at full speed, at shares of it and very slow ones, on mismatched plants with 2.5 kg of which
nobody knows, with a calibration table and without, behind boards that are asked in each cycle and seldom.
"""

from __future__ import annotations

import numpy as np

from qrobot.motion import Generator, MoveRequest, SpeedShare, motion_limits
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.memory.stop_record import read_incident
from tests.support.campaign import FRAME_NS, FRAME_S, PUMA, Floats, N
from tests.support.dead_encoder import Case, SlowArm

LOW, HIGH = PUMA.limits.q_min + 0.05, PUMA.limits.q_max - 0.05
SHARES = (0.01, 0.05, 0.3, 0.95)  # of the joints' greatest speed
RATES = (  # of the servo, with how the velocity is found, and its cycles to each exchange with the board
    (1000.0, "difference", 1),
    (2000.0, "observer", 1),
    (1000.0, "difference", 3),
    (500.0, "difference", 1),
    (1000.0, "observer", 2),
)
STRETCH_S = 300.0
PATIENCE_MS = 20.0  # with a board that is asked seldom


def path(random: np.random.Generator, here: Floats, seconds: float) -> Floats:
    """Random moves for so long, one row a frame; slow ones are short ones."""
    generator, rows, tick = Generator(motion_limits(PUMA), FRAME_S, here), [here], 0
    while len(rows) < seconds / FRAME_S:
        share = float(random.choice(SHARES))
        here = np.clip(here + min(1.0, 5.0 * share) * (random.uniform(LOW, HIGH) - here), LOW, HIGH)
        generator.push(MoveRequest("random", here, SpeedShare(share)))
        moving = True
        while moving:
            tick += 1
            output = generator.update(tick)
            rows.append(output.q)
            moving = output.moving
    return np.array(rows)


def campaign(seconds: float) -> int:
    """Run it; the number of stretches that something stopped."""
    wrong, stretches = 0, round(seconds / STRETCH_S)
    for k in range(stretches):
        rate_hz, velocity, cycles = RATES[k % len(RATES)]
        table = k % 2 == 0
        settings = {} if cycles == 1 else {"board_timeout_ms": PATIENCE_MS}
        arm = SlowArm(Case(1, 0.0, False, table, draw=k), rate_hz, cycles=cycles, velocity=velocity, **settings)
        for seq, q in enumerate(path(np.random.default_rng(k), arm.start, STRETCH_S)):
            arm.rig.mailbox.push_setpoint(1, seq, arm.rig.now_ns, FRAME_NS, [POSITION_SETPOINT] * N, q.tolist())
            arm.rig.run_for(FRAME_S)
        incident = read_incident(arm.rig.state.watch.incident)
        wrong += incident is not None
        looks = "table" if table else "no table"
        print(f"plant {k}, {rate_hz:g} Hz, asked in 1 of {cycles}, {looks}: {incident or 'nothing'}", flush=True)
    print(f"{stretches * STRETCH_S / 60:g} minutes: {wrong} of {stretches} stretches were stopped", flush=True)
    return wrong
