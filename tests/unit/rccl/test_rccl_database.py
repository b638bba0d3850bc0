"""The transform data base: a file that people read, programs change, and nobody tears."""

from __future__ import annotations

import fcntl
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from qrobot import transform_file
from qrobot.errors import ConfigError
from qrobot.motion import TransformKind
from qrobot.rccl import gentr_rpy, gentr_trsl, hold, newtrans, trsl
from qrobot.rccl.database import DataBase
from tests.support.patience import PATIENCE_S, give_time
from tests.support.thorough import examples

COORDINATE = st.floats(-2000, 2000)
ANGLE = st.floats(-180, 180)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "world.tr"


@given(place=st.tuples(COORDINATE, COORDINATE, COORDINATE, ANGLE, ANGLE, ANGLE))
@settings(max_examples=examples(30), suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_what_is_recorded_is_read_again(file, place) -> None:
    one = gentr_rpy("ONE", *place)
    DataBase(file).record(one)
    again = DataBase(file).get("ONE")
    assert again.value == pytest.approx(one.value, abs=1e-7)


def test_the_file_is_a_table_with_a_heading(file) -> None:
    DataBase(file).record(gentr_rpy("TABLE", 500, 50, -300, 10, 20, 30))
    heading, line = file.read_text().splitlines()
    assert heading.split() == ["#", "name", "x", "y", "z", "roll", "pitch", "yaw"]
    assert line.split()[0] == "TABLE"
    assert [float(word) for word in line.split()[1:]] == pytest.approx([500, 50, -300, 10, 20, 30])


def test_edits_by_hand_and_comments_survive_a_change(file) -> None:
    file.write_text("# my own heading\n\nA 1 2 3 0 0 0  # measured on Monday\nB 4 5 6 0 0 90\n")
    base = DataBase(file)
    a = base.get("A", hold)
    assert (a.kind.value, [*a.p]) == ("hold", pytest.approx([1, 2, 3]))
    base.record(trsl(a, 7, 8, 9))
    base.record(gentr_trsl("C", 0, 0, 1))
    base.remove("B")
    text = file.read_text()
    assert text.startswith("# my own heading\n\nA ")
    assert "# measured on Monday" in text
    assert base.names() == ["A", "C"]
    assert [*base.get("A").p] == pytest.approx([7, 8, 9])
    assert base.get("A").kind is TransformKind.HOLD  # "varb" would be followed, whatever the override is


def test_reading_into_a_transform_tells_whether_there_was_one(file) -> None:
    base = DataBase(file)
    t = newtrans("T")
    assert not base.read(t)
    base.record(gentr_trsl("T", 1, 2, 3))
    assert base.read(t)
    assert [*t.p] == pytest.approx([1, 2, 3])


@pytest.mark.parametrize("line", ["A 1 2 3", "A 1 2 3 4 5 six", "A 1 2 3 4 5 6 7"])
def test_a_line_that_cannot_be_read_is_named_and_not_written_over(file, line) -> None:
    file.write_text(f"# heading\n{line}\n")
    with pytest.raises(ConfigError, match=r"world\.tr, line 2: a name and six numbers"):
        DataBase(file).record(gentr_trsl("B", 0, 0, 0))
    assert file.read_text() == f"# heading\n{line}\n"


@pytest.mark.parametrize(
    ("deed", "words"),
    [
        (lambda base: base.get("X"), "no transform 'X'; it has nothing"),
        (lambda base: base.remove("X"), "no transform 'X'"),
        (lambda base: base.record(newtrans("two words")), "a name without spaces"),
        (lambda base: base.record(newtrans("")), "a name without spaces"),
    ],
)
def test_what_is_not_there_or_has_no_name_is_told(file, deed, words) -> None:
    with pytest.raises(ConfigError, match=words):
        deed(DataBase(file))


def test_of_two_programs_that_record_at_the_same_time_neither_loses_the_others(file, monkeypatch) -> None:
    """Each with a lock and a file of its own, as two processes have them."""
    monkeypatch.setattr(transform_file, "_rest", give_time)
    monkeypatch.setattr(transform_file, "PATIENCE_S", PATIENCE_S)

    def program(name: str) -> None:
        for i in range(25):
            DataBase(file).record(gentr_trsl(f"{name}{i}", i, 0, 0))
            DataBase(file).names()  # never a torn line

    with ThreadPoolExecutor() as pool:
        for done in [pool.submit(program, name) for name in "AB"]:
            done.result()
    assert sorted(DataBase(file).names()) == sorted(f"{name}{i}" for name in "AB" for i in range(25))
    assert [DataBase(file).get(f"A{i}").p.x for i in range(25)] == pytest.approx(range(25))
    assert [path.name for path in file.parent.iterdir() if path != file] == ["world.tr.lock"]


def test_a_name_that_stands_there_twice_is_told_and_nothing_is_written(file) -> None:
    file.write_text(text := "A 1 2 3 0 0 0\n# A once more\nA 4 5 6 0 0 0\n")
    data = DataBase(file)
    for use in (lambda: data.get("A"), lambda: data.record(newtrans("A")), lambda: data.remove("A"), data.check):
        with pytest.raises(ConfigError, match=r"world\.tr, line 3: 'A' stands in a line before it"):
            use()
    assert file.read_text() == text


def test_a_program_that_keeps_the_file_locked_is_told_of_and_the_file_stays_as_it_was(file, monkeypatch) -> None:
    DataBase(file).record(gentr_rpy("ONE", 1, 2, 3, 0, 0, 0))
    before = file.read_text()
    monkeypatch.setattr(transform_file, "PATIENCE_S", 0.0)
    with file.with_name(file.name + ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with pytest.raises(ConfigError, match=r"another program has kept .*world\.tr\.lock locked"):
            DataBase(file).record(gentr_rpy("TWO", 1, 2, 3, 0, 0, 0))
    assert file.read_text() == before
    DataBase(file).record(gentr_rpy("TWO", 1, 2, 3, 0, 0, 0))
    assert set(DataBase(file).names()) == {"ONE", "TWO"}
