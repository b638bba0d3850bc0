"""The teach interpreter on an ideal arm."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from qrobot import rccl
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.model.orientation import axis_angle
from qrobot.rccl.offline import OfflineLink
from qrobot.rccl.teach import Teacher
from tests.support.puma import arm as kinematics


@pytest.fixture
def teacher(tmp_path: Path) -> Iterator[Teacher]:
    with rccl.use(OfflineLink), rccl.control("puma560") as arm:
        arm.move(arm.jposition("over", [10, -60, 150, 0, 40, 0]))
        arm.waitas(lambda: arm.time > 3000)
        yield Teacher(arm, rccl.DataBase(tmp_path / "taught.db"))


def pose() -> np.ndarray:
    return kinematics().forward(np.array(rccl.how.q))


def test_a_step_in_the_world_moves_along_the_axes_of_the_base(teacher: Teacher) -> None:
    before = pose()
    teacher.obey("world dx 10 dz -20 rz 5")
    np.testing.assert_allclose(pose()[:3, 3] - before[:3, 3], [0.010, 0, -0.020], atol=1e-9)
    np.testing.assert_allclose(pose()[:3, :3], axis_angle((0, 0, 1), np.radians(5)) @ before[:3, :3], atol=1e-9)


def test_a_step_of_the_tool_moves_along_its_own_axes(teacher: Teacher) -> None:
    before = pose()
    teacher.obey("tool dz 15")
    np.testing.assert_allclose(pose()[:3, 3] - before[:3, 3], 0.015 * before[:3, 2], atol=1e-9)
    np.testing.assert_allclose(pose()[:3, :3], before[:3, :3], atol=1e-9)


def test_what_was_recorded_is_found_again(teacher: Teacher) -> None:
    taught = pose()
    assert teacher.obey("record PART").startswith("recorded PART: at ")
    teacher.obey("world dx 30 dy 20   # away")
    assert not np.allclose(pose(), taught, atol=1e-3)
    teacher.obey("move PART")
    np.testing.assert_allclose(pose(), taught, atol=1e-6)  # the file has micrometres
    assert teacher.obey("list") == "PART"


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("jump", "unknown command 'jump'"),
        ("world", "say directions"),
        ("world dx", "say directions"),
        ("world dx far", "say directions"),
        ("world dq 3", "dq"),
        ("tool dx 5000", "reach"),
        ("move NOWHERE", "no transform 'NOWHERE'"),
        ("record", "say one name"),
    ],
)
def test_mistakes_are_answered_and_end_nothing(teacher: Teacher, line: str, complaint: str) -> None:
    before = pose()
    answer = teacher.obey(line)
    assert answer.startswith("error: ")
    assert complaint in answer
    np.testing.assert_allclose(pose(), before, atol=1e-9)
    assert teacher.obey("world dx 5").startswith("at ")
    assert not teacher.over


def test_the_hand_park_and_the_end(teacher: Teacher) -> None:
    assert teacher.obey("close") == "done"
    assert teacher.obey("  # nothing") == ""
    teacher.obey("park")
    np.testing.assert_allclose(rccl.how.q, rccl.park.q, atol=1e-9)
    teacher.obey("quit")
    assert teacher.over


def test_the_command_reads_a_script_and_goes_on_after_mistakes(tmp_path: Path, capsys) -> None:
    script, taught = tmp_path / "script.txt", tmp_path / "taught.db"
    script.write_text("jump\nworld dx -40\nrecord PART\nquit\nrecord NEVER\n")
    words = ["teach", str(taught), "--offline", "--script", str(script)]
    assert run_app(make_app("teach"), words) == 0
    said = capsys.readouterr().out
    assert "error: unknown command" in said
    assert "recorded PART" in said
    assert rccl.DataBase(taught).names() == ["PART"]


def test_a_script_that_is_not_there_is_refused(tmp_path: Path, capsys) -> None:
    assert run_app(make_app("teach"), ["teach", "--offline", "--script", str(tmp_path / "none")]) == 1
    assert "cannot read" in capsys.readouterr().err
