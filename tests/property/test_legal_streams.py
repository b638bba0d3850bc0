"""Random streams within what the joints may do, none of their frames lost: nothing of the arm is told as broken."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.arrays import Floats
from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.campaign import PUMA, N

LONGEST_S = 2.0
FINE_S = 1e-4  # of the motion that frames are samples of
ROOM = 0.05  # rad to the ends of a joint's range
LARGEST_SHARE = 0.8  # of the bound, of the torque nobody commanded, on an arm that is as its model says
TWO_THIRDS = 2.0 / 3.0  # of the joints take part


def swings(joint: int, share: float, rng: np.random.Generator) -> Floats:
    """One joint back and forth, FINE_S apart: at 0.5 to 0.97 of `share` v_max, with steps to 0.6 to 0.95 a_max."""
    v_max, a_max, start = PUMA.limits.v_max[joint], PUMA.limits.a_max[joint], PUMA.poses["end"][joint]
    fine = np.arange(0.0, LONGEST_S, FINE_S)
    while True:
        times, speeds, way = [0.0], [0.0], rng.choice([-1.0, 1.0])
        while times[-1] < 0.7 * LONGEST_S:
            speed, a = way * share * rng.uniform(0.5, 0.97) * v_max, rng.uniform(0.6, 0.95) * a_max
            times += np.cumsum([times[-1] + abs(speed - speeds[-1]) / a, rng.uniform(0.01, 0.15)]).tolist()
            speeds += [speed, speed]
            way = -way
        times.append(times[-1] + abs(speeds[-1]) / (0.8 * a_max))
        q = start + np.cumsum(np.interp(fine, times, [*speeds, 0.0])) * FINE_S
        if PUMA.limits.q_min[joint] + ROOM < q.min() and q.max() < PUMA.limits.q_max[joint] - ROOM:
            return np.asarray(q)


def stream(rng: np.random.Generator, period_s: float, share: float, joints: float) -> Floats:
    """Setpoints `period_s` apart in which each joint moves with probability `joints`. Shape (k, n)."""
    fine = np.arange(0.0, LONGEST_S, FINE_S)
    rows = np.tile(PUMA.poses["end"], (int(LONGEST_S / period_s), 1))
    for joint in range(N):
        if rng.random() < joints:
            rows[:, joint] = np.interp(period_s * np.arange(len(rows)), fine, swings(joint, share, rng))
    return rows


def push_share(rig: LockstepRig) -> float:
    """Largest torque that nobody commanded now, of any joint, as a share of its bound."""
    return float((np.abs(rig.state.watch.push) / rig.state.watch.threshold).max())


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("share", [0.5, 0.9])
@pytest.mark.parametrize("period_ms", [7, 28])
@pytest.mark.parametrize("velocity", ["difference", "observer"])
def test_no_legal_stream_looks_like_something_broken(velocity: str, period_ms: int, share: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    settings, emulator = ServoSettings(velocity=velocity), Emulator(PUMA, start="end", physics="rigid")
    rig = LockstepRig(PUMA, settings, emulator)
    rig.ticks(3)
    rig.mailbox.request_power(True)
    rig.run_for(0.1)
    largest = 0.0
    for seq, q in enumerate(stream(rng, period_ms / 1000, share, 1.0 if seed % 2 else TWO_THIRDS)):
        rig.mailbox.push_setpoint(1, seq, rig.now_ns, period_ms * 1_000_000, [POSITION_SETPOINT] * N, q.tolist())
        for _ in range(period_ms):
            rig.ticks(1)
            largest = max(largest, push_share(rig))
        state = rig.mailbox.snapshot()
        assert (Mode(state.mode), FaultCode(state.event)) == (Mode.TRACKING, FaultCode.NONE)
    assert largest < LARGEST_SHARE
