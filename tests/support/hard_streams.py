"""Random setpoints within what joints may do, that turn them hard: streams which nothing may stop."""

from __future__ import annotations

from collections.abc import Collection, Iterable

import numpy as np

from qrobot.arrays import Floats
from tests.support.campaign import PUMA, N

LONGEST_S = 2.0
FINE_S = 1e-4  # of the motion that frames are samples of
ROOM = 0.05  # rad to the ends of a joint's range


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


def swings_of(rng: np.random.Generator, period_s: float, share: float, joints: Collection[int]) -> Floats:
    """Setpoints `period_s` apart in which these joints move. Shape (k, n)."""
    return _sampled(rng, period_s, share, [joint in joints for joint in range(N)])


def stream(rng: np.random.Generator, period_s: float, share: float, joints: float) -> Floats:
    """Setpoints `period_s` apart in which each joint moves with probability `joints`. Shape (k, n)."""
    return _sampled(rng, period_s, share, (rng.random() < joints for _ in range(N)))


def _sampled(rng: np.random.Generator, period_s: float, share: float, moves: Iterable[bool]) -> Floats:
    fine = np.arange(0.0, LONGEST_S, FINE_S)
    rows = np.tile(PUMA.poses["end"], (int(LONGEST_S / period_s), 1))
    for joint, moved in enumerate(moves):
        if moved:
            rows[:, joint] = np.interp(period_s * np.arange(len(rows)), fine, swings(joint, share, rng))
    return rows
