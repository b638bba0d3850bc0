"""Share of the joints' greatest speeds at which an arm at reduced speed keeps its limit wherever it stands."""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.model.chain import chain_params
from qrobot.servo.checks.tip_speed import tip_speed

POSES: Final = 512  # [A] over the range; the fastest of them is within 2 % of the fastest there is, 5 % are tolerated
SEED: Final = 1


def speed_share(robot: Robot, tip: Floats, tool_speed: float) -> float:
    """Share of `v_max` at which no motion of the joints moves the tip faster than `tool_speed`, m/s; 1 for 0.

    Args:
        tip: in the frame of the last link, m. Shape (3,).
    """
    if tool_speed <= 0.0:
        return 1.0
    limits, chain, at = robot.limits, chain_params(robot), (float(tip[0]), float(tip[1]), float(tip[2]))
    poses = np.random.default_rng(SEED).uniform(limits.q_min, limits.q_max, (POSES, robot.n))
    alone = np.diag(limits.v_max)
    fastest = max(sum(tip_speed(q, v, chain, at) for v in alone) for q in poses)
    return min(1.0, tool_speed / fastest)
