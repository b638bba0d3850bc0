"""Arms without a closed form for their inverse kinematics."""

from __future__ import annotations

from functools import cache

import numpy as np

from qrobot.config import Robot, load_robot


@cache
def drawn(seed: int) -> Robot:
    """A PUMA whose links have been bent, lengthened and moved: no closed form knows it."""
    random, robot = np.random.default_rng(seed), load_robot("puma560")
    turns = random.choice([-90.0, 0.0, 90.0, 37.0], 6)
    turns[[1, 4]] = 90.0, -90.0  # not all axes parallel
    geometry = robot.geometry.model_copy(update={
        "family": "generic", "alpha_rad": np.radians(turns + random.uniform(-5.0, 5.0, 6)),
        "a_m": random.uniform(-0.4, 0.4, 6), "d_m": random.uniform(-0.3, 0.3, 6),
        "theta_rad": random.uniform(-1.0, 1.0, 6),
    })  # fmt: skip
    return robot.model_copy(update={"name": f"drawn {seed}", "geometry": geometry})


def within(robot: Robot, shares) -> np.ndarray:
    return robot.limits.q_min + shares * (robot.limits.q_max - robot.limits.q_min)
