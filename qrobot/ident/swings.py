"""Swings among steady passes: forwards and back through one place, where what a model does not know errs alike."""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arrays import Floats, Ints
from qrobot.config import Robot
from qrobot.ident.observe import SETTLING_S, Observations

SAME_PLACE: Final = 1e-2  # rad (m), between middles of passes: what an arm may lag behind to either side
SAME_SPEED: Final = 0.1  # share of a motor's speed by which its passes forwards and back may differ


def swings_of(robot: Robot, seen: Observations) -> Ints:
    """Number of the swing of each observation, from 0. Shape (m,).

    Two passes that follow each other are one swing where all motors that both observe turn back at the same speed
    through the same place. Any other pass, as the way to the next place is one, is a swing by itself.
    """
    passes = np.unique(seen.passed)
    number = np.searchsorted(passes, seen.passed)
    place, rate = np.zeros((2, len(passes), robot.n))
    place[number] = seen.q @ robot.transmission.coupling.T
    rate[number, seen.motor] = seen.rate
    begins = np.ones(len(passes), np.bool_)
    for second in range(1, len(passes)):
        both = slice(second - 1, second + 1)
        begins[second] = not (begins[second - 1] and _turns_back(place[both], rate[both]))
    return np.asarray((np.cumsum(begins) - 1)[number])


def _turns_back(place: Floats, rate: Floats) -> bool:
    """Whether the second of two passes is the first one's way back; places and speeds of motors have shape (2, n).

    The middle of either is that much late as its start is left out.
    """
    observed = (rate != 0.0).all(axis=0)
    (forwards, back), apart = rate[:, observed], np.abs(place[1] - place[0])[observed]
    opposite = np.abs(forwards + back) <= SAME_SPEED * np.abs(forwards)
    near = apart <= SAME_PLACE + SETTLING_S * np.abs(forwards)
    return bool(observed.any() and (opposite & near).all())
