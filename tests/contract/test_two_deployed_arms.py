"""A program that was started for one arm, and takes another one of that kind as well: what the deployment file says of
its own arm (names, wired lines, volts, fences, the robot file) counts for that alone."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from qrobot import rci
from qrobot.arcl import ARCL_BRIDGE, IOD_OUT, ArclRobot, Pos, arcl_open, iod_set_value, joint_pos, named_iod, new_iod
from qrobot.cli.arms import inside_fences
from qrobot.cli.run import machine_of
from qrobot.config import robot_path
from qrobot.config.deployment import load_deployment
from qrobot.errors import ConfigError, FenceCrossed, MotionError
from qrobot.multi_rccl import jposition, move, rccl_control, rccl_open, setmode, wait_for
from qrobot.multi_rccl.program import _program
from qrobot.rccl.program import ending
from qrobot.rci import VirtualLink
from qrobot.rci.robot_data import KnownRobot
from tests.support.fake_robot import FakeRobot
from tests.support.puma import PARK

pytestmark = pytest.mark.usefixtures("arcl_alone")

KIND = "puma560"
PLACES = ("127.0.0.1:5600", "127.0.0.1:5601")
DEPLOYMENT = """
[[arm]]
name = "left"
robot = "{robot}"
bridge = {{ port = 5600 }}
signals = [{{ name = "fan", analog_output = 1 }}]

[arm.board]
outputs = [{{ output = 3, name = "vacuum", bit = 4 }}]
analog_outputs = [{{ output = 1, dac = 7, min_v = 0.0, max_v = 2.0 }}]

[[arm.fences.shape]]
name = "window"
shape = "plane"
bodies = "tool"
position_m = [0.72, 0.0, 0.0]
rpy_deg = [0.0, -90.0, 0.0]

[[arm]]
name = "right"
robot = "puma560"
bridge = {{ port = 5601 }}
signals = [{{ name = "fan", analog_output = 2 }}]

[arm.board]
outputs = [{{ output = 3, name = "clamp", bit = 4 }}, {{ output = 5, name = "vacuum", bit = 5 }}]
analog_outputs = [{{ output = 2, dac = 7, min_v = 0.0, max_v = 8.0 }}]
"""
VACUUM, NOWHERE, VOLTS = (3, 5), (5, 1), (2.0, 8.0)  # of left and right
THROUGH = np.degrees(PARK) - np.array([0.0, 0.0, 60.0, 0.0, 0.0, 0.0])  # the window, which only left has


@pytest.fixture
def fakes() -> list[FakeRobot]:
    return [FakeRobot(tuple(PARK)) for _ in PLACES]


@contextmanager
def program_for(own: int, fakes: list[FakeRobot], folder: Path) -> Iterator[None]:
    """What `qrobot run --arm` puts round a program, which reaches both arms."""
    robot = folder / "here.toml"
    robot.write_text(robot_path(KIND).read_text().replace("\nstretched = ", "\nbench = "))
    (folder / "cell.toml").write_text(DEPLOYMENT.format(robot=robot))
    arm = load_deployment(str(folder / "cell.toml")).arm[own]
    ways = {place: partial(VirtualLink, transfer=fake.transfer) for place, fake in zip(PLACES, fakes, strict=True)}
    token = _program.set(None)
    with machine_of((arm,), "bridge", None), inside_fences(arm), rci.use(ways | {KIND: ways[PLACES[own]]}), ending():
        yield
    _program.reset(token)


@pytest.fixture(params=[0, 1], ids=["left", "right"])
def own(request: pytest.FixtureRequest, fakes: list[FakeRobot], tmp_path: Path) -> Iterator[int]:
    """The arm that the program was started for."""
    with program_for(request.param, fakes, tmp_path):
        yield request.param


@pytest.fixture(params=["by its address", "as the program's"])
def arms(request: pytest.FixtureRequest, own: int) -> tuple[ArclRobot, ArclRobot]:
    """The program's own arm, and the other one."""
    named = (ARCL_BRIDGE, f"localhost:560{own}") if request.param == "by its address" else ()
    return arcl_open(*named, 0), arcl_open(ARCL_BRIDGE, PLACES[1 - own], 0)


def through(rp: ArclRobot) -> Pos:
    """The same as ARCL counts joints."""
    return joint_pos(rp, "through", (rp.joints + THROUGH - np.degrees(PARK)).tolist())


def test_names_and_wired_lines_of_the_file_are_those_of_its_arm_alone(
    arms: tuple[ArclRobot, ArclRobot], own: int
) -> None:
    mine, other = arms
    assert named_iod(mine, "vacuum").first == VACUUM[own]
    with pytest.raises(ConfigError, match="no signal 'vacuum', nor any other"):
        named_iod(other, "vacuum")
    with pytest.raises(MotionError, match="is not configured"):
        new_iod(mine, IOD_OUT, NOWHERE[own])
    assert new_iod(other, IOD_OUT, VACUUM[1 - own]).first == VACUUM[1 - own]


def test_ranges_of_volts_are_those_of_the_files_arm_alone(arms: tuple[ArclRobot, ArclRobot], own: int) -> None:
    mine, other = arms
    fan = named_iod(mine, "fan")
    iod_set_value(fan, VOLTS[own])
    with pytest.raises(MotionError, match="is not within"):
        iod_set_value(fan, VOLTS[own] + 0.1)
    for output in (1, 2):
        with pytest.raises(MotionError, match="there is no analogue output"):
            other.write_analog(output, 1.0)


def test_the_robot_file_is_that_of_the_files_arm_alone(arms: tuple[ArclRobot, ArclRobot], own: int) -> None:
    for arm, knows in zip(arms, (own == 0, False), strict=True):
        with nullcontext() if knows else pytest.raises(ConfigError, match="no pose 'bench'"):
            assert arm.pose("bench").name == "BENCH"


def test_motions_of_arcl_keep_off_the_fences_of_the_files_arm_alone(
    arms: tuple[ArclRobot, ArclRobot], own: int
) -> None:
    for arm, fenced in zip(arms, (own == 0, False), strict=True):
        with pytest.raises(FenceCrossed, match="fence 'window'") if fenced else nullcontext():
            arm.judge(through(arm), 0)


def test_motions_of_multi_rccl_keep_off_the_fences_of_the_files_arm_alone(own: int) -> None:
    arms = rccl_open("mine", KIND, PLACES[own]), rccl_open("other", KIND, PLACES[1 - own])
    for arm, fenced in zip(arms, (own == 0, False), strict=True):
        rccl_control(arm)
        setmode(arm, "joint")
        goal = jposition(arm, "through", THROUGH.tolist())
        with pytest.raises(FenceCrossed, match="fence 'window'") if fenced else nullcontext():
            move(arm, goal)
            wait_for(arm.completed)


def test_tasks_of_rci_keep_off_the_fences_of_the_files_arm_alone(own: int) -> None:
    for address in ("", PLACES[own], f":560{own}", f"localhost:560{own}"):
        assert (KnownRobot("arm", KIND, address).data().fences is not None) == (own == 0)
    for address in (PLACES[1 - own], f":560{1 - own}", ":5609", "elsewhere"):
        assert KnownRobot("arm", KIND, address).data().fences is None
