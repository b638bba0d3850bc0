"""One program, two arms: a square traced by a PUMA and by a Stanford arm, which has a boom in place of an elbow."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from qrobot import rccl
from qrobot.config import load_robot
from qrobot.modecodes import Mode
from qrobot.model.arm import Arm
from qrobot.motion import TransformKind, Trsf
from qrobot.rccl import EQ, TL, gentr_trsl, makeposition, t6
from qrobot.rccl.offline import OfflineLink
from qrobot.rccl.trace import Trace
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator

EDGE = 80.0  # mm
CORNERS = [(EDGE, 0.0), (EDGE, EDGE), (0.0, EDGE), (0.0, 0.0)]
ARMS = ["puma560", "stanford"]


def square(name: str) -> None:
    """The program; only the name of the arm differs."""
    robot = load_robot(name)
    tool = gentr_trsl("TOOL", 0, 0, 50)
    start = Trsf("START", TransformKind.CONST, Arm(robot).forward(robot.poses["park"]) @ tool.value)
    with rccl.control(name) as arm:
        arm.setmode("cartesian")
        arm.setvel(100, 90)
        for k, (x, y) in enumerate(CORNERS):
            arm.move(makeposition(f"C{k}", t6, tool, EQ, start, gentr_trsl("AT", x, y, 0), TL, tool))
        arm.waitfor(arm.completed)


def tips(name: str, path: np.ndarray) -> np.ndarray:
    """The tip of the tool in the plane of the square, mm. Shape (samples, 3)."""
    robot = load_robot(name)
    arm, tool = Arm(robot), gentr_trsl("TOOL", 0, 0, 50).value
    back = np.linalg.inv(arm.forward(robot.poses["park"]) @ tool)
    return 1000.0 * np.array([(back @ arm.forward(q) @ tool)[:3, 3] for q in path])


def off_the_square(tip: np.ndarray) -> np.ndarray:
    """Distance of each place from the sides, mm; the corners are rounded inwards. Shape (samples,)."""
    inside = np.abs(tip[:, :2] - EDGE / 2).max(axis=1)
    return np.hypot(np.maximum(inside - EDGE / 2, 0.0), tip[:, 2])


@pytest.mark.parametrize("name", ARMS)
def test_the_same_program_traces_the_square_with_either_arm(name: str) -> None:
    traces: list[Trace] = []
    with rccl.use(OfflineLink, traces):
        square(name)
    tip = tips(name, traces[0].setpoints.q)
    assert off_the_square(tip).max() < 1e-6
    for x, y in CORNERS:
        assert np.linalg.norm(tip - [x, y, 0.0], axis=1).min() < 10.0
    assert tip[-1] == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)


def test_a_stanford_arm_on_an_emulated_board_traces_the_square() -> None:
    robot = load_robot("stanford")
    rig = LockstepRig(robot, ServoSettings(rate_hz=1000.0), Emulator(robot))
    with rccl.use(partial(link_factory, rig, 28_000)):
        square("stanford")
    rows = rig.rows()
    tracked = rows[rows["mode"] == Mode.TRACKING]
    assert off_the_square(tips("stanford", tracked["q"][::10])).max() < 5.0
    assert tips("stanford", tracked["q"][-1:])[0] == pytest.approx([0.0, 0.0, 0.0], abs=3.0)
