"""Numbers larger than any float, and motions that would never end, are refused by ARCL as errors of ours."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from qrobot import arcl
from qrobot.arcl.robot import ArclRobot
from qrobot.config import load_robot
from qrobot.errors import MotionError
from qrobot.rci.machine_choice import MachineChoice, use_machine
from tests.support.arcl import ANALOG_RANGES, PARK, SIGNALS, forget_programs, offline

LARGE, HUGE = 10**400, 10**5000  # Python does not write the second one
DIGITS = "a number of thousands of digits"


@pytest.fixture(scope="module")
def robot() -> Iterator[ArclRobot]:
    forget_programs()
    with use_machine(MachineChoice("offline", None, load_robot("puma560"), SIGNALS, None, ANALOG_RANGES)):
        yield offline()
    forget_programs()


CALLS: dict[str, Callable[[ArclRobot, int], object]] = {
    "a position": lambda rp, number: arcl.joint_pos(rp, "p", (number, *PARK[1:])),
    "a vector": lambda _, number: arcl.vect_dot((number, 1, 2), (0, 0, 1)),
    "a coordinate": lambda _, number: setattr(arcl.new_vector(1, 2, 3), "x", number),
    "a time": lambda rp, number: arcl.move(rp, arcl.joint_pos(rp, "p", PARK), arcl.MOV_TIME, number, 0),
    "an override": arcl.arcl_override,
    "a way back": lambda rp, number: arcl.arcl_keep_path(rp, True, number),
    "a line": lambda rp, number: arcl.new_iod(rp, arcl.IOD_OUT, number),
    "lines": lambda rp, number: arcl.new_iod(rp, arcl.IOD_OUT, 1, number),
    "a word": lambda rp, number: arcl.iod_write(arcl.new_iod(rp, arcl.IOD_OUT, 1), number),
    "volts": lambda rp, number: arcl.iod_set_value(arcl.named_iod(rp, "power"), number),
    "a grip": lambda rp, number: arcl.gripper(rp, arcl.GRIP_OPEN_BY, number),
    "a load": arcl.arcl_setload,
    "a period": lambda _, number: offline(arcl.ARCL_PERIOD, number),
}


@pytest.mark.parametrize("call", CALLS)
def test_a_number_larger_than_any_float_is_refused(robot: ArclRobot, call: str) -> None:
    with pytest.raises(MotionError):
        CALLS[call](robot, LARGE)
    with pytest.raises(MotionError, match=DIGITS):
        CALLS[call](robot, HUGE)


@pytest.mark.parametrize(
    ("attribute", "number"),
    [(arcl.MOV_JVEL, 1e-200), (arcl.MOV_JVEL, 1e-100), (arcl.MOV_TIME, 1e100), (arcl.MOV_TIME, 1e203)],
)
def test_a_motion_that_would_never_end_is_refused(robot: ArclRobot, attribute, number: float) -> None:
    arcl.move(robot, arcl.joint_pos(robot, "p", (60.0, *PARK[1:])), attribute, number, 0)
    with pytest.raises(MotionError, match="more samples than can be counted"):
        arcl.arcl_wait(robot)
