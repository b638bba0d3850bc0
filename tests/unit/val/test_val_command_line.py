"""`qrobot val run`, without the arms behind it."""

from __future__ import annotations

import pytest

from qrobot.cli.val import _execute
from tests.support.val_runs import interpreter, main_program

PLACES = ".LOCATIONS\na 450 150 0 90 90 0\nb 450 -150 0 90 90 0\n.END"


def test_ctrl_c_brings_the_arm_to_rest_and_tells_the_line(capsys: pytest.CaptureFixture[str]) -> None:
    with interpreter(main_program("x = 1", "MOVE a", "MOVE b", rest=PLACES)) as (run, _):
        arm, sample, samples = run.machine.arm, run.machine.arm.sample, iter(range(1, 10_000))

        def press() -> None:
            sample()
            if next(samples) == 10:
                raise KeyboardInterrupt

        arm.sample = press  # type: ignore[method-assign]
        with pytest.raises(KeyboardInterrupt):
            _execute(run, "main", 1, 100.0)
        assert arm.idle
        assert 0.451 < run.machine.frame("here")[0, 3] < 0.625  # on its way to a
    assert "interrupted in program main, line " in capsys.readouterr().err
