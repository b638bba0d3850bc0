"""Programs of RCI as a user runs them: off line, in lock-step."""

from __future__ import annotations

import re
import runpy
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from qrobot import rccl, rci
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.modecodes import Mode
from qrobot.rccl.offline import OfflineLink
from qrobot.rci import LinkFactory
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.puma import PARK, ROBOT

EXAMPLES = Path(__file__).parents[2] / "examples"
SMOOTH_S = 0.03  # of the examples
MIRROR = np.array([-1.0, 1.0, 1.0, -1.0, 1.0, -1.0])
TABLE = """\
 tick  task    run count
    0  first           1
    2  second          1
    4  first           1
    6  second          1
    8  first           1
   10  second          1
   12  first           1
   14  second          1
first: 4 runs, 0 missed
second: 4 runs, 0 missed
"""


def test_the_table_of_two_tasks_is_the_same_every_time_s10(capsys: pytest.CaptureFixture[str]) -> None:
    for way in ("--offline", "--offline", "--lockstep"):
        assert run_app(make_app("run"), ["run", way, str(EXAMPLES / "15_rci_tasks.py")]) == 0
        assert capsys.readouterr().out == TABLE


def test_a_task_that_swings_a_joint_in_lockstep_reads_the_very_counts_and_dac_words_of_the_servo() -> None:
    rig = LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0))
    seen: list[tuple[int, rci.RawWords]] = []

    def swing(td: rci.TaskDescriptor) -> None:
        q = np.array(PARK)
        q[0] += 0.2 * (1.0 - np.cos(2.0 * np.pi * td.runs / 50))
        td.chg.go_to(tuple(q.tolist()))
        assert td.robot is not None
        seen.append((td.how.t_ns, td.robot.raw(td.how)))

    with rci.use(partial(link_factory, rig, 28_000)):
        td = rci.rci_create("puma560")
        rci.rci_control(td, swing)
        rci.rci_start(td.bit)
        rci.rci_wait(lambda: td.runs == 100)
        rci.rci_close()
    rig.run_for(0.5)
    rows = rig.rows()
    at = {int(t): i for i, t in enumerate(rows["t_ns"])}
    assert [(rows["counts"][at[t]] == raw.encoder_counts).all() for t, raw in seen] == [True] * 100
    assert [(rows["dac"][at[t]] == raw.dac).all() for t, raw in seen] == [True] * 100
    assert np.ptp([raw.encoder_counts[0] for _, raw in seen]) > 3000
    assert (rows[-1]["mode"], rows["fault"].any()) == (Mode.HOLDING, False)


@pytest.mark.parametrize(
    ("name", "period_s", "swing", "samples", "late"),
    [
        ("16_mirror.py", 0.028, [25.0, 15.0, -20.0, 10.0, 20.0, -15.0], 300, 1),
        ("27_compiled_mirror.py", 0.004, [5.0, 3.0, -4.0, 2.0, 4.0, -3.0], 400, 2),
    ],
)
def test_one_arm_mirrors_another_sample_by_sample(
    name: str, period_s: float, swing: list[float], samples: int, late: float, capsys: pytest.CaptureFixture[str]
) -> None:
    """By the program at 28 ms, and by a compiled function, which is a sample later, at 4 ms."""

    def behind(links: dict[str, LinkFactory]) -> float:
        with rci.use(links):
            runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        return float(re.findall(r"at most (\S+) degrees", capsys.readouterr().out)[0])

    rigs = {name: LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0)) for name in ("left", "right")}
    in_a_sample = swing[0] * np.pi / samples  # degrees, where the swing is fastest
    late += SMOOTH_S / period_s
    assert behind(dict.fromkeys(rigs, OfflineLink)) == pytest.approx(late * in_a_sample, abs=0.006)  # as printed
    real = behind({name: partial(link_factory, rig, 28_000) for name, rig in rigs.items()})
    # setpoints are played out, and what was measured comes, a sample later each; and the servos' own errors
    assert late * in_a_sample < real < (late + 2) * in_a_sample + 0.15
    left, right = (rig.rows() for rig in rigs.values())
    assert not left["fault"].any()
    assert not right["fault"].any()
    away = np.abs(left["q"] - PARK).max(axis=1).argmax()
    assert left["q"][away] - PARK == pytest.approx(np.radians(swing), abs=0.01)
    slave = right["q"][np.abs(right["q"] - PARK).max(axis=1).argmax()]
    assert slave == pytest.approx(MIRROR * left["q"][away], abs=0.01)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["16_mirror.py", "27_compiled_mirror.py"])
def test_a_mirror_begins_wherever_the_arms_stand(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """The slave goes to the mirror image of the master first, within what its joints can."""
    start = np.radians([50.0, -70.0, 170.0, 20.0, 60.0, -40.0])
    rigs = {
        "left": LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0), Emulator(ROBOT, start=start)),
        "right": LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0)),
    }
    with rci.use({name: partial(link_factory, rig, 28_000) for name, rig in rigs.items()}):
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    assert float(re.findall(r"at most (\S+) degrees", capsys.readouterr().out)[0]) < 1.5
    left, right = (rig.rows() for rig in rigs.values())
    assert not left["fault"].any()
    assert not right["fault"].any()
    assert right["q"][-1] == pytest.approx(MIRROR * left["q"][-1], abs=0.02)


def test_a_hybrid_controller_in_the_place_of_the_generator_makes_a_spring_of_one_joint(capsys) -> None:
    rig = LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0))
    with rci.use(partial(link_factory, rig, 28_000)):
        runpy.run_path(str(EXAMPLES / "17_spring.py"), run_name="__main__")
    rows = rig.rows()
    assert not rows["fault"].any()
    gone = rows["q"] - PARK
    assert 0.45 < gone[-1, 0] < 0.55  # what friction of the joint leaves: it is compensated, not removed
    assert np.abs(gone[:, 1:]).max() < 0.02
    assert np.abs(np.diff(gone[:, 0])).max() * 1000.0 < 0.7  # rad/s: damped
    assert "joint 1 has gone" in capsys.readouterr().out


def test_an_arm_of_rccl_follows_what_a_camera_task_of_rci_sees(capsys: pytest.CaptureFixture[str]) -> None:
    """Off line to the same number each time; in lock-step the servo is up to two samples later."""

    def followed(link: LinkFactory) -> tuple[float, float]:
        with rccl.use(link), rci.use(link):
            runpy.run_path(str(EXAMPLES / "25_camera_task.py"), run_name="__main__")
        speed, distance = re.findall(r"([0-9.]+) mm", capsys.readouterr().out)
        return float(speed), float(distance)

    rig = LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0))
    runs = [followed(link) for link in (OfflineLink, OfflineLink, partial(link_factory, rig, 28_000))]
    assert runs[0] == runs[1]
    assert [speed for speed, _ in runs] == pytest.approx([60.0] * 3, abs=1.0)
    sample = 60.0 * 0.028  # mm of the belt
    assert runs[0][1] == pytest.approx(sample, abs=0.5)  # and the camera's pixel
    assert sample < runs[2][1] < 3 * sample
    assert not rig.rows()["fault"].any()


@pytest.mark.realtime
def test_the_table_of_two_tasks_in_real_time_has_both_in_turn_s10(capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(str(EXAMPLES / "15_rci_tasks.py"), run_name="__main__")
    lines = capsys.readouterr().out.splitlines()
    names = [line.split()[1] for line in lines[1:-2]]
    assert abs(names.count("first") - names.count("second")) <= 1
    assert len(names) >= 7


FAILING = """
from qrobot import rccl, rci
from tests.support.rci_compiled import fail

td = rci.rci_create("filter", "compiled")
rci.rci_shared_memory("filter", 8)
rci.rci_control(td, fail)
rci.rci_onclock(td, 1)
rci.rci_start(td.bit)
while td.active:
    pass
"""


@pytest.mark.realtime
def test_the_exit_status_tells_of_a_task_that_failed_when_the_program_does_not_ask() -> None:
    ended = subprocess.run(
        [sys.executable, "-c", FAILING], check=False, cwd=Path(__file__).parents[2], capture_output=True, text=True
    )
    assert (ended.returncode, ended.stderr) == (1, "rci: ValueError: the compiled function cannot go on\n")
