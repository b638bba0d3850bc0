"""A call that tells the servo a payload comes back when that is in force, however late the servo hears of it."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any

import pytest

from qrobot.errors import MotionError
from qrobot.rci.arm_settings import HEARD, ArmSettings
from qrobot.servo.stages.payload import RAMP_S
from qrobot.units import NS_PER_S
from qrobot.wire import Mode, Payload, RobotState

STILL = (0.0,) * 6


class SlowServo:
    """A link to a servo that takes a payload so many samples after it was told, and carries it `RAMP_S` later."""

    def __init__(self, period_s: float, late: int, deaf: bool = False) -> None:
        self.sample = 0
        self.mass = 0.0
        self.since_s: float | None = None  # it goes over to the newest one
        self._period_s, self._late, self._deaf = period_s, late, deaf
        self._told: list[tuple[int, Payload]] = []
        self._goal = Payload(0.0)

    @property
    def now_s(self) -> float:
        return self.sample * self._period_s

    def tell(self, packet: Payload) -> None:
        if not self._deaf:
            self._told.append((self.sample + self._late, packet))

    def refusal(self, _: type) -> str:
        return ""

    def how(self) -> RobotState:
        return RobotState(
            t_ns=round(self.now_s * NS_PER_S), mode=Mode.HOLDING, q=STILL, v=STILL, tau=STILL, q_setpoint=STILL,
            payload_mass=self.mass,
        )  # fmt: skip

    def wait(self, predicate: Any) -> None:
        while not predicate():
            self.sample += 1
            if self._told and self._told[0][0] <= self.sample:
                self._goal, self.since_s = self._told.pop(0)[1], self.now_s
            if self.carries:
                self.mass = self._goal.mass

    @property
    def carries(self) -> bool:
        """What it has taken last is in force."""
        return self.since_s is not None and self.now_s - self.since_s >= RAMP_S - 1e-9


def settings_of(servo: SlowServo) -> ArmSettings:
    link: Any = servo
    return ArmSettings("arm", lambda: link, nullcontext, servo.wait, lambda: servo.sample, servo.how)


@pytest.mark.parametrize("late", range(1, HEARD + 1))
@pytest.mark.parametrize("period_s", [0.001, 0.028, 0.1])
def test_a_payload_is_in_force_when_the_call_is_over_also_one_of_the_same_mass(period_s: float, late: int) -> None:
    servo = SlowServo(period_s, late)
    settings = settings_of(servo)
    for mass, height_m in ((1.0, 0.04), (1.0, 0.2), (2.0, 0.2), (2.0, 0.0)):
        servo.since_s, told_s = None, servo.now_s
        settings.tell(Payload(mass, (0.0, 0.0, height_m)))
        assert servo.carries
        assert servo.now_s - told_s < RAMP_S + (HEARD + 1.5) * period_s


def test_a_servo_that_never_carries_it_is_told_of() -> None:
    with pytest.raises(MotionError, match="arm has not answered: it carries 0 kg still"):
        settings_of(SlowServo(0.028, 1, deaf=True)).tell(Payload(1.0))
