"""Equations of fast motion out of a log: means over short windows (`window`).

Measured positions are used, not the servo's references: an arm with unknown friction does not quite follow. A motor is
left out of a window in which it is ever so slow that its friction is another.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from qrobot.arrays import Bools, Floats, Ints
from qrobot.config import Robot
from qrobot.errors import IdentificationError
from qrobot.hwif.registers import DAC_ZERO
from qrobot.ident.base import BaseParameters
from qrobot.ident.dropouts import between_cycles, measured_positions
from qrobot.ident.excitation import RUN_S
from qrobot.ident.fourier import States
from qrobot.ident.observe import RESOLUTION, slowest_rates
from qrobot.ident.recording import sound
from qrobot.ident.regressor import Regressor
from qrobot.ident.window import window_weights
from qrobot.modecodes import Mode
from qrobot.servo.memory.telemetry import Rows

WINDOW_S: Final = 0.1  # a sixteenth of the fastest swing of a plan; encoder steps leave 0.01 rad/s2
SHORTEST_S: Final = 0.9 * RUN_S  # from rest to rest: shorter motions are ways between
RESTS: Final = 0.005  # of each joint's greatest speed: an arm whose joints are all slower rests between motions


@dataclass(frozen=True, eq=False)
class MotionRows:
    """One row for each motor and window; motor side, joint units.

    Attributes:
        motor: which, from 0. Shape (m,).
        motion: number of the motion from rest to rest. Shape (m,).
        columns: what multiplies the base parameters. Shape (m, b).
        rate: of the motor, rad/s (m/s). Shape (m,).
        rotors: torque the rotors take, N m (N). Shape (m,).
        torque: commanded, N m (N). Shape (m,).
        doubt: its resolution, N m (N). Shape (m,).
    """

    motor: Ints
    motion: Ints
    columns: Floats
    rate: Floats
    rotors: Floats
    torque: Floats
    doubt: Floats

    def __len__(self) -> int:
        return len(self.motor)

    def only(self, chosen: Bools) -> MotionRows:
        """The rows that are chosen, shape (m,)."""
        return MotionRows(*(getattr(self, field.name)[chosen] for field in fields(self)))


def observe_motion(robot: Robot, regressor: Regressor, base: BaseParameters, rows: Rows, period_s: float) -> MotionRows:
    """The equations of every motion of a log, rows of shape (r,), that goes on for some seconds.

    Args:
        robot: whose log it is.
        regressor: of its inertia and gravity.
        base: parameters of the regressor.
        rows: telemetry. Rows of several logs may follow each other.
        period_s: from row to row.

    Raises:
        IdentificationError: there is no such motion.
    """
    samples = round(WINDOW_S / period_s)
    moves = (np.abs(rows["v_ref"]) > RESTS * robot.limits.v_max).any(axis=1)
    starts, motion = _windows(rows, moves, sound(rows, period_s), samples, round(SHORTEST_S / period_s))
    if not len(starts):
        raise IdentificationError("nothing recorded moves for long: record what `qrobot identify plan --dynamic` shows")
    weights, coupling = window_weights(samples, period_s), robot.transmission.coupling
    q = between_cycles(measured_positions(rows))
    at = States(*(_means(q, starts, weight) for weight in weights))
    dac_per_Nm = robot.transmission.dac_per_Nm
    torque = _means((rows["dac"][:-1] - DAC_ZERO) / dac_per_Nm, starts, weights.value)
    rate, rate_change = at.v @ coupling.T, at.a @ coupling.T
    rotor = robot.transmission.gear**2 * robot.transmission.rotor_inertia
    window, motor = np.nonzero(np.abs(rate) - 0.5 * WINDOW_S * np.abs(rate_change) > slowest_rates(robot))
    columns = np.linalg.inv(coupling.T) @ base.columns(regressor(*at))
    return MotionRows(
        motor=motor,
        motion=motion[window],
        columns=columns[window, motor],
        rate=rate[window, motor],
        rotors=(rotor * rate_change)[window, motor],
        torque=torque[window, motor],
        doubt=np.abs(RESOLUTION / dac_per_Nm)[motor],
    )


def _windows(rows: Rows, moves: Bools, good: Bools, samples: int, shortest: int) -> tuple[Ints, Ints]:
    """First rows of windows that follow each other, all of them good, and the number of the motion of each."""
    follows = np.append(np.diff(rows["tick"]) == 1, [False])
    under_way = moves & follows & (rows["mode"] == Mode.TRACKING)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], under_way, [False]]).astype(np.int8))).reshape(-1, 2)
    found = [
        (start, number)
        for number, (begin, end) in enumerate(edges[np.ptp(edges, axis=1) >= shortest].tolist())
        for start in range(begin, end - samples, samples)
        if good[start : start + samples].all()
    ]
    starts, motion = np.array(found, np.int64).reshape(-1, 2).T
    return starts, motion


def _means(values: Floats, starts: Ints, weight: Floats) -> Floats:
    """Weighted sums of values (r, n) over windows. Shape (m, n)."""
    return np.asarray(sliding_window_view(values, len(weight), axis=0)[starts] @ weight)
