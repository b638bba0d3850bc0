"""Zero the force sensor: what it shows of an arm at rest counts as no load from then on, until the servo ends.

The channels are read for a while beside the loop, which goes on. Nothing that moves or stops the arm depends on the
zero; laws that use a sensor read its volts.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Protocol

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import QRobotError
from qrobot.modecodes import Mode, mode_name
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.parameters import STANDSTILL_RAD_S
from qrobot.servo.settings import ServoSettings

READINGS: Final = 40  # [A] of each channel, some of which are of the same conversion
MOST_SCATTER_V: Final = 0.1  # [A] deviation of a channel's readings; a converter of 8 bits between two steps has 0.04
MOST_VOLTS: Final = 9.9  # [A] of the converter's 10: beyond, the sensor is overloaded or its cable is off


class Sensing(Protocol):
    """Parts of a servo process that zeroing touches."""

    settings: ServoSettings

    @property
    def mailbox(self) -> ServoMailbox:
        """The servo memory."""

    @property
    def volts(self) -> Floats:
        """Volts at the converter's channels, as the loop has them. Shape (8,)."""

    @property
    def force_zero(self) -> Floats:
        """Volts without a load; the loop reads what is written here. Shape (8,)."""


def zero_force(servo: Sensing, pause: Callable[[], None]) -> dict[int, float]:
    """Take the mean of what the sensor shows for its zero; by channel, V.

    Args:
        pause: called between two readings.

    Raises:
        QRobotError: the arm has no force sensor, is not at rest, or a channel shows what can be no zero.
    """
    sensor = servo.settings.force_sensor
    if sensor is None:
        raise QRobotError("this arm has no force sensor: its channels stand in [arm.servo.force_sensor]")
    channels, readings = list(sensor.channels), []
    for _ in range(READINGS):
        _insist_on_rest(servo)
        readings.append(np.array(servo.volts[channels]))
        pause()
    zero = np.mean(readings, axis=0)
    for channel, volts, scatter in zip(channels, zero.tolist(), np.std(readings, axis=0).tolist(), strict=True):
        if not abs(volts) <= MOST_VOLTS:
            raise QRobotError(
                f"channel {channel} of the force sensor shows {volts:.3g} V, which is no zero: "
                "check its cable and its load"
            )
        if scatter > MOST_SCATTER_V:
            raise QRobotError(
                f"channel {channel} of the force sensor scatters by {scatter:.2g} V about {volts:.3g} V: "
                "does somebody touch the arm, or does its load swing?"
            )
    servo.force_zero[channels] = zero  # a cycle in between may see some of the old ones, once
    return dict(zip(channels, zero.tolist(), strict=True))


def _insist_on_rest(servo: Sensing) -> None:
    """Raise QRobotError unless the arm holds or is without power, and stands still."""
    snapshot = servo.mailbox.snapshot()
    if snapshot.mode not in (Mode.OFF, Mode.HOLDING):
        raise QRobotError(f"not in mode {mode_name(snapshot.mode)}: a force sensor is zeroed while the arm is at rest")
    if not np.all(np.abs(snapshot.v) <= STANDSTILL_RAD_S):
        raise QRobotError("the arm moves: a force sensor is zeroed while it is at rest")
