"""`qrobot identify record` on a running arm: what it says when the moves do not come to their end."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.cli.identify_record import says_where_it_broke_off
from qrobot.errors import ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.ident.plan import Swing

POSE = Swing("pose 9", np.zeros(6), np.ones(6), 1.5, 0.25)


def break_off(error: BaseException, told: list[int]) -> None:
    """A recording that ends in an error during the ninth move."""
    with says_where_it_broke_off(lambda number, _move: told.append(number)) as tell:
        tell(7, POSE)
        tell(8, POSE)
        raise error


@pytest.mark.parametrize("error", [ServoFault(FaultCode.FOLLOWING, "joint 4"), KeyboardInterrupt()])
def test_how_to_go_on_is_said(error: BaseException, capsys: pytest.CaptureFixture[str]) -> None:
    told: list[int] = []
    with pytest.raises(type(error)):
        break_off(error, told)
    assert told == [7, 8]
    said = " ".join(capsys.readouterr().err.split())
    assert "it broke off in pose 9" in said
    assert "--first 9 " in said


def test_nothing_is_said_of_moves_that_were_made(capsys: pytest.CaptureFixture[str]) -> None:
    with says_where_it_broke_off(lambda _number, _move: None) as tell:
        tell(0, POSE)
    assert capsys.readouterr().err == ""


def test_nothing_is_said_where_no_move_had_begun(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ServoFault), says_where_it_broke_off(lambda _number, _move: None):
        raise ServoFault(FaultCode.FOLLOWING, "before the first")
    assert capsys.readouterr().err == ""
