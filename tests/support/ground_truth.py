"""What only an emulator can tell: how far the servo's estimates and torques are from the truth.

The rig notes the plant's true velocity at the instant of every image the servo gets, so an estimate can be held against
what it estimates. One call of the compiled loop per cycle makes it slower than the plain rig.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.modecodes import Mode
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.memory.telemetry import Rows
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator

RIPPLE_WINDOW_S: Final = 0.028  # torque is held against its mean over one sample period of RCCL
CRUISE_RAD_S2: Final = 0.01  # smaller desired accelerations are cruise or rest


@dataclass(frozen=True)
class TrackedTruth:
    """Tracking cycles of a run and the plant's true velocities at their images.

    Attributes:
        rows: telemetry, shape (rows,).
        v_true: rad/s or m/s, shape (rows, n).
        dt: length of a cycle, s.
    """

    rows: Rows
    v_true: Floats
    dt: float

    @property
    def velocity_error(self) -> Floats:
        """Rms of estimated less true velocity, rad/s or m/s. Shape (n,)."""
        return _rms(self.rows["v"] - self.v_true)

    @property
    def lag_s(self) -> Floats:
        """By how much the estimate lags, s: the share of the true acceleration in its error. Shape (n,)."""
        acceleration = np.gradient(self.v_true, self.dt, axis=0)
        error = self.rows["v"] - self.v_true
        return np.asarray(-(error * acceleration).sum(axis=0) / (acceleration**2).sum(axis=0))

    @property
    def ripple(self) -> Floats:
        """Largest torque beside its mean over `RIPPLE_WINDOW_S` while cruising or at rest, N m or N. Shape (n,)."""
        width = 2 * round(0.5 * RIPPLE_WINDOW_S / self.dt) + 1
        beside = self.rows["tau"] - _moving_mean(self.rows["tau"], width)
        bent = (np.abs(self.rows["a_ref"]) > CRUISE_RAD_S2).any(axis=1)
        calm = _moving_mean(bent[:, None].astype(np.float64), width)[:, 0] < 0.5 / width
        calm[:width], calm[-width:] = False, False
        return np.asarray(np.abs(beside[calm]).max(axis=0))

    @property
    def torque_step(self) -> Floats:
        """Largest change of torque from one cycle to the next, N m or N. Shape (n,)."""
        return np.asarray(np.abs(np.diff(self.rows["tau"], axis=0)).max(axis=0))

    @property
    def tracking_error(self) -> Floats:
        """Rms of desired less measured position, rad or m. Shape (n,)."""
        return _rms(self.rows["q_ref"] - self.rows["q"])

    @property
    def largest_error(self) -> Floats:
        """Largest difference of desired and measured position, rad or m. Shape (n,)."""
        return np.asarray(np.abs(self.rows["q_ref"] - self.rows["q"]).max(axis=0))


class GroundTruthRig(LockstepRig):
    """A lock-step rig that knows the truth. Arguments as of `LockstepRig`; telemetry is always kept."""

    def __init__(self, robot: Robot, settings: ServoSettings, emulator: Emulator | None = None) -> None:
        super().__init__(robot, settings, emulator)
        self._seen: list[Floats] = []

    def ticks(self, n: int) -> None:
        """Advance by `n` servo cycles, noting the truth before each."""
        for _ in range(n):
            self._seen.append(self.emulator.v)
            super().ticks(1)

    def tracked_truth(self) -> TrackedTruth:
        """Everything seen while the servo tracked setpoints."""
        rows = self.rows()
        tracking = rows["mode"] == Mode.TRACKING
        return TrackedTruth(rows[tracking], np.array(self._seen)[tracking], self.period_ns * 1e-9)


def _rms(values: Any) -> Floats:
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def _moving_mean(values: Floats, width: int) -> Floats:
    """Mean over `width` rows centred on each, shape (rows, n); nearer to the ends than that it means nothing."""
    kernel = np.full(width, 1.0 / width)
    return np.array([np.convolve(column, kernel, mode="same") for column in values.T]).T
