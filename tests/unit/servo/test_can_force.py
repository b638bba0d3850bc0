"""A force sensor on CAN, end to end: its frames, the converter's channels, the servo, and a program's `how.force`.

On virtual time: the sensor speaks and is heard by the clock of the rig.
"""

from __future__ import annotations

import math
import struct
import uuid
from collections.abc import Iterator
from functools import partial

import can
import numpy as np
import pytest

from qrobot import rccl
from qrobot.config.can_sensor import CanSensor
from qrobot.config.force_calibration import ForceCalibration
from qrobot.hwif.bus import Bus, Endpoint
from qrobot.hwif.canbus.sensor import SensorBus
from qrobot.rig.lockstep import START_NS, link_factory
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.units import NS_PER_MS
from tests.support.bus import DirectBus, at_once
from tests.support.puma import ROBOT
from tests.support.transport_rig import TransportRig

ID, PERIOD_MS, TIMEOUT_MS = 0x181, 10, 50.0
CHANNELS = (6, 7)  # fz and tz; below are the potentiometers'
NEWTON_PER_VOLT, NEWTON_METRE_PER_VOLT = 20.0, 2.0
VOLT_PER_COUNT = 0.001
STEP_V = 10.0 / 2048  # of the converter
SIGNALS = [{"channel": 6, "id": ID, "volt_per_count": VOLT_PER_COUNT},
           {"channel": 7, "id": ID, "first": 2, "volt_per_count": VOLT_PER_COUNT}]  # fmt: skip
SHEET = ForceCalibration.model_validate({
    "channels": CHANNELS,
    "matrix": [(0.0, 0.0), (0.0, 0.0), (NEWTON_PER_VOLT, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, NEWTON_METRE_PER_VOLT)],
})  # fmt: skip


class EmulatedSensor:
    """Sends force and torque along z every 10 ms, and is the clock by which it is heard.

    Attributes:
        fz, tz: N and N m. silent: it sends nothing.
    """

    def __init__(self) -> None:
        self.fz = self.tz = 0.0
        self.silent = False
        self.rig: TransportRig | None = None
        self._channel, self._next_ns = uuid.uuid4().hex, 0
        self._bus = can.Bus(interface="virtual", channel=self._channel)

    def __call__(self) -> int:
        now_ns = START_NS if self.rig is None else self.rig.now_ns
        if now_ns >= self._next_ns and not self.silent:
            self._next_ns = now_ns + PERIOD_MS * NS_PER_MS
            counts = self.fz / NEWTON_PER_VOLT / VOLT_PER_COUNT, self.tz / NEWTON_METRE_PER_VOLT / VOLT_PER_COUNT
            data = struct.pack("<hh", *map(round, counts))
            self._bus.send(can.Message(arbitration_id=ID, data=data, is_extended_id=False))
        return now_ns

    def heard_beside(self, end: Endpoint) -> Bus:
        """The bus to a board, with the sensor."""
        config = {"interface": "virtual", "channel": self._channel, "timeout_ms": TIMEOUT_MS, "signals": SIGNALS}
        self._listener = SensorBus(DirectBus(end), CanSensor.model_validate(config), self, aside=at_once)
        return self._listener

    def close(self) -> None:
        """Off the wire, and nobody listens."""
        self._listener.close()
        self._bus.shutdown()


@pytest.fixture
def sensor() -> Iterator[EmulatedSensor]:
    sensor = EmulatedSensor()
    yield sensor
    sensor.close()


@pytest.fixture
def rig(sensor: EmulatedSensor) -> TransportRig:
    settings = ServoSettings(rate_hz=500.0, force_sensor=SHEET)
    sensor.rig = TransportRig(ROBOT, settings, sensor.heard_beside, Emulator(ROBOT, physics="rigid"))
    return sensor.rig


def test_a_program_reads_the_force_of_a_sensor_on_can_and_nan_once_it_is_silent(
    rig: TransportRig, sensor: EmulatedSensor
) -> None:
    def settle(arm: rccl.Channel) -> np.ndarray:
        until = arm.time + 200.0
        arm.waitas(lambda: arm.time >= until)
        return np.array(arm.how.force)

    with rccl.use(partial(link_factory, rig, 28_000)), rccl.control() as arm:
        for sensor.fz, sensor.tz in ((0.0, 0.0), (-35.0, 4.0), (80.0, -12.5)):
            force = settle(arm)
            assert force[2] == pytest.approx(sensor.fz, abs=NEWTON_PER_VOLT * STEP_V)
            assert force[5] == pytest.approx(sensor.tz, abs=NEWTON_METRE_PER_VOLT * STEP_V)
            assert np.isnan(np.delete(force, [2, 5])).all()  # the sheet knows nothing of the others
        sensor.silent = True
        assert all(map(math.isnan, settle(arm)))
        sensor.silent = False
        assert settle(arm)[2] == pytest.approx(80.0, abs=NEWTON_PER_VOLT * STEP_V)


def test_the_log_has_its_volts_and_its_newtons_and_tells_when_it_was_silent(
    rig: TransportRig, sensor: EmulatedSensor
) -> None:
    sensor.fz = 50.0
    rig.run_for(0.2)
    sensor.silent = True
    silent_ns = rig.now_ns
    rig.run_for(0.3)
    rows = rig.rows()
    heard = rows[rows["t_ns"] == silent_ns - rig.period_ns][0]
    assert heard["volts"][6] == pytest.approx(50.0 / NEWTON_PER_VOLT, abs=STEP_V)
    assert heard["force"][2] == pytest.approx(NEWTON_PER_VOLT * heard["volts"][6], rel=1e-12)
    lost_ns = rows["t_ns"][(rows["t_ns"] > silent_ns) & np.isnan(rows["force"][:, 2])][0]
    assert TIMEOUT_MS - PERIOD_MS < (lost_ns - silent_ns) / NS_PER_MS < TIMEOUT_MS + 100.0
