"""The teach interpreter on an ideal arm."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from qrobot import rccl
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.errors import ConfigError, MotionError
from qrobot.model.orientation import axis_angle
from qrobot.rccl.offline import OfflineLink
from qrobot.rccl.teach import Teacher
from qrobot.rccl.teach_transform import teach
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


def test_a_step_along_a_named_frame_moves_and_turns_along_its_axes(teacher: Teacher, tmp_path: Path) -> None:
    teacher.obey("world rz 20 ry 30")
    teacher.obey("record TABLE")
    axes = pose()[:3, :3]
    teacher.obey("joint 1 15")
    before = pose()
    assert teacher.obey("frame TABLE dz -20 rx 10").startswith("at ")
    np.testing.assert_allclose(pose()[:3, 3] - before[:3, 3], axes @ [0.0, 0.0, -0.02], atol=1e-5)
    turned = pose()[:3, :3] @ before[:3, :3].T
    np.testing.assert_allclose(
        turned, axes @ rccl.gentr_rot("R", 0, 0, 0, [1, 0, 0], 10).value[:3, :3] @ axes.T, atol=1e-5
    )


def test_one_joint_is_stepped_by_hand(teacher: Teacher) -> None:
    before = np.array(rccl.how.q)
    teacher.obey("joint 2 -5")
    np.testing.assert_allclose(np.degrees(np.array(rccl.how.q) - before), [0, -5, 0, 0, 0, 0], atol=1e-9)


def test_joint_positions_are_typed_and_told_in_degrees(teacher: Teacher) -> None:
    assert teacher.obey("joints 10 -50 170.5 -1 40 0") == "joints 10.00 -50.00 170.50 -1.00 40.00 0.00"
    np.testing.assert_allclose(np.degrees(rccl.how.q), [10, -50, 170.5, -1, 40, 0], atol=1e-9)
    told = teacher.obey("joints")
    teacher.obey("park")
    assert teacher.obey(told) == told


def test_an_answer_has_the_numbers_that_make_the_same_transform(teacher: Teacher) -> None:
    for line in ("world dx 10 rz 5 ry 20", "tool rx -35", "where", "record PART"):
        numbers = [float(number) for number in re.findall(r"-?\d+\.\d", teacher.obey(line))]
        made = rccl.gentr_rpy("SAME", *numbers).value
        np.testing.assert_allclose(made[:3, 3], pose()[:3, 3], atol=1e-4)
        np.testing.assert_allclose(made[:3, :3], pose()[:3, :3], atol=2e-3)


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
        ("frame NOWHERE dx 5", "no transform 'NOWHERE'"),
        ("frame", "say one name"),
        ("record", "say one name"),
        ("joint 3", "say a joint and how far"),
        ("joint 9 5", "joints 1 to 6"),
        ("joint 3 inf", "inf is not a finite number"),
        ("joints 1 2 3", "has 6 joints, not 3"),
        ("joints 0 0 0 0 0 far", "a number for each joint"),
        ("joints 0 0 0 0 0 nan", "nan is not a finite number"),
        ("joints 0 0 9000 0 0 0", "joint 3 (elbow) at 9000.00 deg is outside"),
        ("world dx 5 dx 5", "each once"),
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


def test_the_command_reads_a_script(tmp_path: Path, capsys) -> None:
    script, taught = tmp_path / "script.txt", tmp_path / "taught.db"
    script.write_text("# PART\n\nworld dx -40\nrecord PART\nquit\nrecord NEVER\n")
    assert run_app(make_app("teach"), ["teach", str(taught), "--offline", "--script", str(script)]) == 0
    assert "recorded PART" in capsys.readouterr().out
    assert rccl.DataBase(taught).names() == ["PART"]


@pytest.mark.parametrize("by", ["script", "pipe"])
@pytest.mark.parametrize("mistake", ["jump", "joint 9 5", "joint 1 900", "world dx 5000", "record"])
def test_a_script_ends_with_the_first_line_that_cannot_be_done(
    tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch, mistake: str, by: str
) -> None:
    """A place recorded behind a motion that was refused would be another one than its author meant."""
    text, taught = f"record PART\n{mistake}\nrecord PART\nrecord NEVER\n", tmp_path / "taught.db"
    (tmp_path / "script.txt").write_text(text)
    monkeypatch.setattr("sys.stdin", io.StringIO(text))
    words = ["--script", str(tmp_path / "script.txt")] if by == "script" else []
    assert run_app(make_app("teach"), ["teach", str(taught), "--offline", *words]) == 1
    said = capsys.readouterr()
    assert said.out.count("recorded") == 1
    assert f"qrobot: line 2, {mistake!r}: " in said.err
    assert rccl.DataBase(taught).names() == ["PART"]


@pytest.mark.parametrize(
    ("database", "complaint"),
    [
        ("none/parts.db", "is there such a folder"),
        ("bad.db", "bad.db, line 1: a name and six numbers"),
        (".", "cannot"),
    ],
)
def test_a_data_base_in_which_nothing_could_be_recorded_is_refused_before_the_arm_moves(
    database: str, complaint: str, tmp_path: Path, capsys
) -> None:
    (tmp_path / "bad.db").write_text("HOLE 1 2 3 nan 0 0\n")
    assert run_app(make_app("teach"), ["teach", "--offline", str(tmp_path / database)]) in (1, 2)
    assert complaint in capsys.readouterr().err


def test_a_data_base_in_whose_folder_nothing_can_be_written_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(**_: object) -> None:
        raise PermissionError(13, "Permission denied")

    (tmp_path / "parts.db").touch()
    monkeypatch.setattr("tempfile.TemporaryFile", refuse)
    with pytest.raises(ConfigError, match=r"cannot write .*parts\.db: Permission denied"):
        rccl.DataBase(tmp_path / "parts.db").check()


def test_a_script_that_is_not_there_is_refused(tmp_path: Path, capsys) -> None:
    assert run_app(make_app("teach"), ["teach", "--offline", "--script", str(tmp_path / "none")]) == 1
    assert "cannot read" in capsys.readouterr().err


# ------------------------------------------------------------------------ lessons: the library's own teach

TOOL = rccl.gentr_trsl("E", 0, 0, 50)


class Person:
    """Answers one question after the other, and remembers what was asked and said."""

    def __init__(self, *answers: str) -> None:
        self.asked: list[str] = []
        self.told: list[str] = []
        self._answers = iter(answers)

    def ask(self, question: str) -> str:
        self.asked.append(question)
        try:
            return next(self._answers)
        except StopIteration:
            raise EOFError from None

    def tell(self, text: str) -> None:
        self.told.append(text)


def lesson(part: rccl.Transform, person: Person, database: rccl.DataBase | None = None) -> int:
    p = rccl.makeposition("GET", rccl.t6, TOOL, rccl.EQ, part, rccl.TL, TOOL)
    return teach(rccl.program.arm(), part, p, database, person.ask, person.tell)


@pytest.fixture
def part(teacher: Teacher) -> rccl.Transform:
    return rccl.newtrans("PART")


def test_a_lesson_gives_the_transform_the_value_of_its_last_record(part: rccl.Transform) -> None:
    person = Person("record", "world dz -20", "record", "q")
    assert lesson(part, person) == rccl.YES
    np.testing.assert_allclose(part.value, pose() @ TOOL.value, atol=1e-9)
    assert person.told[0] == "teach mode V1.0, transform PART, position GET"
    assert person.asked == ["? "] * 4


@pytest.mark.parametrize(
    ("answers", "asked"),
    [
        (("world dx 5", "q", "n", "help", "q", "y"), "nothing taught, exit ? (y/n) "),
        (("record", "q!"), "? "),
        (("tool dz 1",), "? "),
    ],
)
def test_a_lesson_without_a_record_that_counts_leaves_the_transform_as_it_was(part, answers, asked) -> None:
    person = Person(*answers)
    assert lesson(part, person) == rccl.NO
    assert person.asked[-1] == asked
    np.testing.assert_array_equal(part.value, np.eye(4))


def test_a_lesson_that_was_saved_needs_nobody_the_next_time(part: rccl.Transform, tmp_path: Path) -> None:
    base = rccl.DataBase(tmp_path / "parts.db")
    assert lesson(part, Person("record", "q", "n"), base) == rccl.YES
    assert base.names() == []
    assert lesson(part, Person("record", "q", "y"), base) == rccl.YES
    again = rccl.newtrans("PART")
    assert lesson(again, Person(), base) == rccl.YES
    np.testing.assert_allclose(again.value, part.value, atol=1e-6)


def test_a_lesson_for_a_transform_that_the_equation_lacks_is_refused_before_it_begins(part) -> None:
    other, person = rccl.newtrans("OTHER"), Person()
    p = rccl.makeposition("GET", rccl.t6, rccl.EQ, part, rccl.TL, part)
    with pytest.raises(MotionError, match="cannot be solved for OTHER"):
        teach(rccl.program.arm(), other, p, ask=person.ask)
    assert person.asked == []
