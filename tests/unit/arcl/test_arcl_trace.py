"""The trace formats of Figure 5, to the character."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.arcl import new_trans_rpy, new_trans_tr
from qrobot.arcl.trace import done_line, exec_line, request_line, trans_line


def test_transforms_are_printed_as_in_the_figure() -> None:
    assert trans_line(new_trans_tr("base", 0, 0, 862)) == (
        "base : x:0.000 y:0.000 z:862.000 RPY r:0.000 p:-0.000 y:0.000"
    )
    assert trans_line(new_trans_rpy("p", 500, 600, 800, 0, 30, 0)) == (
        "p : x:500.000 y:600.000 z:800.000 RPY r:0.000 p:30.000 y:0.000"
    )


@pytest.mark.parametrize(
    ("values", "line"),
    [
        (("PARK", 0, 1, 100, 300, 0, 0, None), "request PARK: t=0, traj=1, Ta=100, Tseg=300, Vt=0, Vr=0"),
        (("PARK", 0, 1, 100, 0, 10, 10, "run"), "request PARK: t=0, traj=1, Ta=100, Tseg=0, Vt=10, Vr=10, conf=run"),
        (("STOP", 272048, 1, 100, 300, 10, 10, None), "request STOP: t=272048, traj=1, Ta=100, Tseg=300, Vt=10, Vr=10"),
    ],
)
def test_requests_are_printed_as_in_the_figure(values: tuple, line: str) -> None:
    assert request_line(*values) == line


@pytest.mark.parametrize(
    ("values", "line"),
    [
        (("PARK", 0.0, 280), "exec(stdtg) PARK: t=0.00, stat=0, j Ta1=112, Ta2=112, Tseg=280, dT=56"),
        (("pos", 0.336, 0), "exec(stdtg) pos: t=0.34, stat=0, j Ta1=112, Ta2=112, Tseg=0, dT=56"),
        (("PARK", 136.192, 0), "exec(stdtg) PARK: t= 136.19, stat=0, j Ta1=112, Ta2=112, Tseg=0, dT=56"),
    ],
)
def test_executions_are_printed_as_in_the_figure(values: tuple, line: str) -> None:
    name, t_s, tseg = values
    assert exec_line(name, t_s, 0, "j", 112, 112, tseg, 56.0) == line


def test_the_end_is_printed_as_in_the_figure() -> None:
    assert done_line("offl", 272.048) == "ami_offl: done at t=272.048"
    assert np.isclose(272.048 / 0.056, 4858)
