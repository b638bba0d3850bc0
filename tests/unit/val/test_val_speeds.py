"""No motion of VAL is faster than its SPEED, whatever library is below, and however short it is."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.arrays import Floats
from qrobot.config import load_robot
from qrobot.val.interpreter import RunState
from tests.support.val_runs import interpreter, main_program, number

PERIOD_S = 0.028
ROUNDED = 1.02  # the way over a sample is shorter than its arc, and the speed of a corner is rounded to samples
PLACES = """
.LOCATIONS
c 450 0 -100 90 90 0
.END
"""
POLYGON = (
    "MOVE SHIFT(c BY 60)",
    "BREAK",
    "TIMER 1 = 0",
    "FOR k = 1 TO n",
    "{speed}",
    "{move} SHIFT(c BY 60*COS(360*k/n), 60*SIN(360*k/n))",
    "END",
    "BREAK",
    "x = TIMER(1)",
)


def _around(library: str, n: int, speed: str, move: str) -> tuple[Floats, Floats, float]:
    """Joints (rows, 6) and tool's tip (rows, 3) at each sample of a polygon of n corners, and the time it took."""
    lines = [f"n = {n}", *(line.format(speed=speed, move=move) for line in POLYGON)]
    with interpreter(main_program(*lines, rest=PLACES), library=library) as (run, _):
        arm, joints, tips = run.machine.arm, [], []
        sample = arm.sample

        def look() -> None:
            sample()
            if ("x", ()) not in run.machine.values and run.machine.values.get(("k", ())) is not None:
                joints.append(arm.q)
                tips.append(run.machine.frame("here")[:3, 3])

        arm.sample = look  # type: ignore[method-assign]
        assert run.execute("main") is RunState.COMPLETED, run.message
        return np.array(joints), np.array(tips), number(run, "x")


@pytest.mark.sampled(3)
@pytest.mark.parametrize("library", ["rccl", "arcl"])
@pytest.mark.parametrize(("n", "mm_s"), [(6, 80.0), (12, 80.0), (24, 30.0), (48, 20.0)])
def test_a_polygon_of_straight_lines_is_no_faster_than_its_mmps(library: str, n: int, mm_s: float) -> None:
    _, tips, seconds = _around(library, n, f"SPEED {mm_s} MMPS", "MOVES")
    fastest = float(np.linalg.norm(np.diff(tips, axis=0), axis=1).max()) / PERIOD_S
    assert 0.8 * mm_s < fastest * 1e3 <= ROUNDED * mm_s
    assert 2e-3 * n * 60.0 * np.sin(np.pi / n) <= mm_s * 1e-3 * seconds


@pytest.mark.parametrize("library", ["rccl", "arcl"])
def test_a_polygon_of_joint_motions_is_no_faster_than_its_per_cent(library: str) -> None:
    joints, _, _ = _around(library, 12, "SPEED 4", "MOVE")
    shares = np.abs(np.diff(joints, axis=0)).max(axis=0) / PERIOD_S / load_robot("puma560").limits.v_max
    assert 0.03 < float(shares.max()) <= ROUNDED * 0.04


CORNERS = (
    "MOVE TRANS(450, 150, 0, 90, 90, 0)|MOVES TRANS(464, 223, -86, -146, 45, 0)|MOVE TRANS(500, 239, -52, 90, 60, -90)",
    "MOVE TRANS(450, 150, 0, 90, 90, 0)|MOVE TRANS(424, 209, -136, 0, 60, 30)|MOVES TRANS(422, 129, 169, 45, 90, 30)"
    "|MOVE TRANS(404, 195, 276, 90, 80, -32)|MOVES TRANS(395, -180, -256, 90, 90, 30)|DEPART -6|DEPARTS 15"
    "|MOVE TRANS(597, 46, -298, 45, 90, 0)|APPRO TRANS(423, 237, 139, 45, 45, 30), 15"
    "|MOVES TRANS(451, -263, 122, 45, 80, -90)",
)


@pytest.mark.parametrize("lines", CORNERS)
@pytest.mark.parametrize("monitor_speed", [100.0, 50.0])
def test_at_full_speed_a_corner_is_entered_only_as_fast_as_it_can_be_gone_round(
    lines: str, monitor_speed: float
) -> None:
    """A look at a few places of the corner missed the peaks between them, at which the arm was then stopped."""
    with interpreter(main_program(*lines.split("|")), library="arcl") as (run, _):
        run.machine.arm.override = monitor_speed
        assert run.execute("main") is RunState.COMPLETED, run.message
