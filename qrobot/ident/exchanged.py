"""Whether torques of two motors were exchanged, on the way from the converters to the log or in the robot file.

What a motor gives is explained by its own gravity and friction, whatever their values and the sign and size of its
torque. Where two motors' torques are explained much better by each other's, they were exchanged.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from qrobot.config import Robot
from qrobot.errors import IdentificationError
from qrobot.ident.observe import Observations

BETTER: Final = 0.05  # product of two motors' errors, over that as they stand
FEWEST: Final = 16  # passes in which both turn


def check_torques(robot: Robot, observations: Observations) -> None:
    """Raise IdentificationError when the torques of two motors were exchanged; names them."""
    for i, j in zip(*np.triu_indices(robot.n, 1), strict=True):
        a, b = (_passes(observations, motor) for motor in (int(i), int(j)))
        both = sorted(set(a) & set(b))
        if len(both) < FEWEST:
            continue
        mine, others = (np.array([rows[number] for number in both]) for rows in (a, b))
        as_it_is = _left(observations, mine, mine) * _left(observations, others, others)
        if _left(observations, mine, others) * _left(observations, others, mine) < BETTER * as_it_is:
            first, second = robot.joint_names[i], robot.joint_names[j]
            raise IdentificationError(
                f"the torque of {first} is what {second} needs, and the reverse: "
                "two columns of torques are exchanged in the log, or two motors in the robot file"
            )


def _passes(observations: Observations, motor: int) -> dict[int, int]:
    """Row of each pass in which a motor turns."""
    rows = np.flatnonzero(observations.motor == motor)
    return dict(zip(observations.passed[rows].tolist(), rows.tolist(), strict=True))


def _left(observations: Observations, by: NDArray[np.int64], of: NDArray[np.int64]) -> float:
    """Share of the torques of rows `of` that gravity and friction of rows `by` cannot explain."""
    rate = observations.rate[by]
    A = np.column_stack([observations.gravity[by], rate, rate > 0.0, rate < 0.0])
    torque = observations.torque[of]
    left = torque - A @ np.linalg.lstsq(A, torque, rcond=1e-9)[0]
    return float(np.linalg.norm(left) / max(float(np.linalg.norm(torque - torque.mean())), 1e-12))
