"""Stops of a servo under a program that keeps its path, and what the path behind them has to be like."""

from __future__ import annotations

import numpy as np

from qrobot.arrays import Floats
from qrobot.faultcodes import FaultCode
from qrobot.motion.kept import WAY_BACK_SHARE
from tests.support.fake_robot import FakeRobot
from tests.support.puma import LIMITS, PERIOD_S

SAG = 0.02  # rad
ROUNDING = 1e-9
SLOW = WAY_BACK_SHARE * LIMITS.v_max * PERIOD_S * (1.0 + ROUNDING)  # from setpoint to setpoint, on a way back


def fail(robot: FakeRobot, way: str) -> None:
    """A stop that leaves the arm under power, or a fault in which it sags a little."""
    if way == "stop":
        robot.halt(FaultCode.STREAM_LOST)
    else:
        robot.break_down(FaultCode.FOLLOWING)
        robot.q = tuple(np.array(robot.q) + SAG)


def check_goes_on(before: Floats, after: Floats, nominal: Floats, way: str, same: float = ROUNDING) -> None:
    """Setpoints (samples, n) before a stop and after it lead slowly back to the `nominal` path, and on along it.

    Places that are less than `same` apart, rad, are one.
    """
    coarseness = np.abs(np.diff(nominal, axis=0)).max()
    off = np.abs(after[:, None] - nominal[None]).max(axis=2).min(axis=1) > coarseness
    assert np.flatnonzero(np.diff(off.astype(int))).size <= 1  # once back on the path, always on it
    assert off.any() == (way == "fault")
    assert np.abs(before[-1] - after).max(axis=1).min() < same  # no place is left out
    assert (np.abs(np.diff(after[off], axis=0)) <= SLOW).all()
    assert (np.abs(np.diff(after, n=2, axis=0)) / PERIOD_S**2 <= LIMITS.a_max * (1.0 + ROUNDING)).all()


def check_way_back(back: Floats) -> None:
    """Setpoints (samples, n) of a way back after a collision are slow, and end at rest."""
    v, a = np.diff(back, axis=0) / PERIOD_S, np.diff(back, n=2, axis=0) / PERIOD_S**2
    assert (np.abs(v) <= 0.2 * LIMITS.v_max).all()
    assert (np.abs(a) <= 0.3 * LIMITS.a_max).all()
    assert np.abs(v[-2:]).max() < 1e-6
