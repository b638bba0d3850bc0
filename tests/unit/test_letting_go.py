"""An arm is let go of however a program ends, and its first error is the one that is told."""

from __future__ import annotations

import pytest

from qrobot.errors import LinkError, MotionError, QRobotError, letting_go


@pytest.mark.parametrize("error", [None, MotionError("first"), KeyboardInterrupt(), SystemExit(0)])
@pytest.mark.parametrize("late", [None, LinkError("late")])
def test_the_error_of_the_block_is_told_before_that_of_letting_go(
    error: BaseException | None, late: QRobotError | None
) -> None:
    let_go: list[str] = []

    def release() -> None:
        let_go.append("the arm")
        if late is not None:
            raise late

    told: BaseException | None = None
    try:
        with letting_go(release):
            if error is not None:
                raise error
    except BaseException as raised:
        told = raised
    assert told is (error if error is not None else late)
    assert let_go == ["the arm"]
