"""What the demo does when the machine it runs on stalls."""

from __future__ import annotations

import pytest

from qrobot.cli.demo import _tried_twice
from qrobot.errors import QRobotError, Stalled
from qrobot.rig.experiment import STALLS


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
