"""What the demo does when the machine it runs on stalls."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from qrobot.cli.demo import _tried_twice
from qrobot.config import load_robot
from qrobot.errors import QRobotError, Stalled
from qrobot.faultcodes import FaultCode
from qrobot.log.header import header_for
from qrobot.log.read import Log
from qrobot.rig.experiment import STALLS, stalled_before_fault
from qrobot.servo.mailbox import FLAG_UNSEEN
from qrobot.servo.modes import Mode
from qrobot.servo.telemetry import TelemetryLayout


class Attempts:
    """Fails with these errors, one after the other, and then succeeds."""

    def __init__(self, *errors: Exception) -> None:
        self.errors, self.made = list(errors), 0

    def __call__(self) -> str:
        self.made += 1
        if self.errors:
            raise self.errors.pop(0)
        return "result"


@pytest.fixture
def told() -> list[str]:
    return []


def test_a_run_that_a_stall_stopped_is_made_once_more_and_people_are_told_why(told: list[str]) -> None:
    attempts = Attempts(Stalled("BOARD_GONE"))
    assert _tried_twice(attempts, told.append) == "result"  # type: ignore[arg-type, comparison-overlap]
    assert attempts.made == 2
    assert "BOARD_GONE" in told[0]


def test_a_machine_that_stalls_again_is_an_error(told: list[str]) -> None:
    with pytest.raises(Stalled):
        _tried_twice(Attempts(Stalled("first"), Stalled("second")), told.append)  # type: ignore[arg-type]


def test_what_the_arm_did_is_not_tried_again(told: list[str]) -> None:
    attempts = Attempts(QRobotError("COLLISION"))
    with pytest.raises(QRobotError, match="COLLISION"):
        _tried_twice(attempts, told.append)  # type: ignore[arg-type]
    assert (attempts.made, told) == (1, [])
    assert STALLS.isdisjoint({"COLLISION", "FOLLOWING", "ENC_STUCK", "JOINT_LIMIT"})


PERIOD_NS, FAULT_ROW = 1_000_000, 150
STALLS_OF = pytest.mark.parametrize(  # so many cycles, up to that row
    ("cycles", "row", "stalled"), [(6, 130, True), (3, 130, False), (6, 80, False), (6, 160, False)]
)


def log_of_a_fault() -> Log:
    """A punctual run of 200 cycles that ends in RUNAWAY."""
    rows = TelemetryLayout(6).empty(200)
    rows["tick"] = np.arange(200)
    rows["t_ns"] = PERIOD_NS * rows["tick"]
    rows["mode"] = Mode.TRACKING
    rows["mode"][FAULT_ROW:], rows["fault"][FAULT_ROW:] = Mode.FAULT, FaultCode.RUNAWAY
    return Log(Path("a.mcap"), header_for(load_robot("puma560"), PERIOD_NS, "qrobot"), rows)


def test_a_fault_on_a_punctual_machine_is_the_arms() -> None:
    assert not stalled_before_fault(log_of_a_fault())


@STALLS_OF
def test_a_fault_soon_after_images_stayed_away_for_long_is_the_machines(cycles: int, row: int, stalled: bool) -> None:
    log = log_of_a_fault()
    log.rows["flags"][row - cycles : row] |= FLAG_UNSEEN
    assert stalled_before_fault(log) is stalled


@STALLS_OF
def test_so_is_one_soon_after_the_servo_itself_stood_still(cycles: int, row: int, stalled: bool) -> None:
    log = log_of_a_fault()
    log.rows["t_ns"][row:] += cycles * PERIOD_NS
    assert stalled_before_fault(log) is stalled


def test_a_run_without_a_fault_blames_nobody() -> None:
    log = log_of_a_fault()
    log.rows["fault"] = 0
    log.rows["t_ns"][100:] += 20 * PERIOD_NS
    assert not stalled_before_fault(log)
