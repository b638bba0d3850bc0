"""The machine layer on its own: it moves an arm without the rest of ARCL (Corke & Kirkham, section 3.2)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from qrobot.arcl import ARCL_AMI, MOV_TIME, arcl_close, arcl_open, arcl_wait, joint_pos, move
from qrobot.arcl.machine import MachineSettings, machine, machine_names, register_machine
from qrobot.arcl.machine.digital import get_bits, set_bits
from qrobot.arcl.machine.offline import OfflineMachine
from qrobot.arcl.stream import read_stream
from qrobot.config import load_robot
from qrobot.errors import ConfigError, MotionError

pytestmark = pytest.mark.usefixtures("arcl_alone")

STANFORD = load_robot("stanford")


def test_a_machine_calls_a_function_once_per_sample_and_delivers_what_it_gives(tmp_path: Path) -> None:
    settings = MachineSettings(STANFORD, np.zeros(6), 20.0, tmp_path / "run.arcl", "by hand")
    ami, seen = machine("offline", settings), []
    stands = ami.open()

    def cycle(sample):
        seen.append(sample)
        return stands + 1e-3 * len(seen)

    ami.start(cycle)
    ami.wait(lambda: ami.treal() >= 200.0)
    ami.grip(1, 0.0)
    ami.close(power_off=False)
    assert [sample.t_ms for sample in seen] == pytest.approx([20.0 * k for k in range(11)])
    assert np.allclose(seen[-1].q, stands + 1e-3 * 10)
    assert np.allclose(seen[-1].v, 1e-3 / 0.020)
    stream = read_stream(tmp_path / "run.arcl")
    assert (stream.start.robot, stream.start.structure, stream.start.program) == ("stanford", "RRPRRR", "by hand")
    assert not stream.damage


def test_a_program_runs_on_a_machine_of_its_own_by_name() -> None:
    made = []

    class Mine(OfflineMachine):
        name = "mine"

        def __init__(self, settings: MachineSettings) -> None:
            super().__init__(settings)
            made.append(self)

    register_machine("mine", Mine)
    assert "mine" in machine_names()
    rp = arcl_open(ARCL_AMI, "mine", 0)
    goal = (10.0, 120.0, -10.0, 0.0, 45.0, -170.0)
    move(rp, joint_pos(rp, "goal", goal), MOV_TIME, 1500, 0)
    arcl_wait(rp)
    assert made == [rp.ami]
    assert np.allclose(rp.joints, goal)
    arcl_close(rp)


def test_a_machine_that_nobody_knows_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"no machine layer 'x'; there are .*offline"):
        machine("x", MachineSettings(STANFORD, np.zeros(6)))


@pytest.mark.parametrize(("first", "count", "value"), [(1, 1, 1), (3, 4, 9), (16, 1, 1), (1, 16, 0xFFFF)])
def test_a_group_of_lines_is_bits_of_a_word(first: int, count: int, value: int) -> None:
    word = set_bits(0x5A5A, first, count, value)
    assert get_bits(word, first, count) == value
    mask = ((1 << count) - 1) << (first - 1)
    assert word & ~mask == 0x5A5A & ~mask


@pytest.mark.parametrize(
    ("first", "count", "value"), [(0, 1, 1), (16, 2, 1), (1, 0, 0), (1, 2, 4), (1, 2, -1), (17, 1, 0)]
)
def test_lines_that_are_not_there_are_refused(first: int, count: int, value: int) -> None:
    with pytest.raises(MotionError):
        set_bits(0, first, count, value)
