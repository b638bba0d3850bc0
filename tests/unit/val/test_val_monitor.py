"""The monitor of VAL II: abbreviations, programs run, paused and continued, places taught, files."""

from __future__ import annotations

from pathlib import Path

import pytest

from qrobot.config import load_robot
from qrobot.val.check import check_text
from qrobot.val.monitor import HELP, ValMonitor
from tests.support.val_runs import EXAMPLES, interpreter, main_program


def session(text: str, *lines: str) -> list[str]:
    """Answers to commands."""
    with interpreter(text) as (run, _):
        monitor = ValMonitor(run)
        return [monitor.obey(line) for line in lines]


def test_commands_are_known_by_abbreviations_down_to_uniqueness() -> None:
    text = main_program("x = 1")
    assert session(text, "EXEC main", "ex MAIN", "LISTR") == ["completed", "completed", "x 1"]
    assert session(text, "LIST") == ["error: column 1: LIST may be LISTP, LISTL, LISTR"]
    assert session(text, "MOVE a")[0].startswith("error: column 1: there is no command MOVE; ? lists them, and DO")
    assert all(name in session(text, "?")[0] for name in HELP)


def test_a_paused_program_is_looked_at_and_continued() -> None:
    file = (EXAMPLES / "07_pause_and_proceed.v2").read_text()
    answers = session(file, "EX main", "STATUS", "DELETEP main", "NEXT", "LISTR", "PROCEED", "PROCEED")
    assert answers == [
        "paused: PAUSE in program main",
        "paused PAUSE in program main",
        "error: a program is to be continued; ABORT first",
        "paused: at step 6 of program main",
        "step 2",
        "completed",
        "error: there is nothing to go on with: completed",
    ]


def test_a_program_that_is_executed_in_place_of_a_paused_one_is_told_so() -> None:
    file = (EXAMPLES / "07_pause_and_proceed.v2").read_text()
    answers = session(file, "EX main", "EX nobody", "STATUS", "EX main", "ABORT", "EX main")
    assert answers == [
        "paused: PAUSE in program main",
        "error: there is no program nobody",
        "paused PAUSE in program main",
        "main, paused, is given up; paused: PAUSE in program main",
        "aborted",
        "paused: PAUSE in program main",
    ]


def test_somebody_at_a_terminal_is_asked_before_a_paused_program_is_given_up() -> None:
    asked, answers = [], [False, True]

    def sure(question: str) -> bool:
        asked.append(question)
        return answers.pop(0)

    with interpreter((EXAMPLES / "07_pause_and_proceed.v2").read_text()) as (run, _):
        monitor = ValMonitor(run)
        monitor.sure = sure
        assert monitor.obey("EX main") == "paused: PAUSE in program main"
        assert monitor.obey("EX nobody") == "error: there is no program nobody"
        assert monitor.obey("EX main") == "nothing has been done; PROCEED goes on"
        assert monitor.obey("NEXT") == "paused: at step 6 of program main"  # where it was
        assert monitor.obey("EX main") == "main, paused, is given up; paused: PAUSE in program main"
    assert asked == ["main, paused, will be given up: are you sure (Y/N)? "] * 2


def test_files_are_found_without_their_suffix(tmp_path: Path) -> None:
    assert session(main_program("x = 1"), f"STORE {tmp_path}/it", "EX main", f"LOAD {tmp_path}/it")[2].startswith(
        "1 prog"
    )
    assert [path.name for path in tmp_path.iterdir()] == ["it.v2"]
    assert "cannot read" in session("", f"LOAD {tmp_path}/other")[0]


def test_a_mistake_in_a_file_is_told_with_its_name_and_nothing_of_it_is_taken(tmp_path: Path) -> None:
    file = tmp_path / "wrong.v2"
    file.write_text(main_program("x = 1", "MOVE"))
    loaded, programs = session("", f"LOAD {tmp_path}/wrong", "LISTP")
    assert loaded.startswith(f"error: {file}, line 3, column 1: MOVE: expected 1 argument")
    assert programs == ""


def test_places_are_taught_listed_stored_and_loaded(tmp_path: Path) -> None:
    file = tmp_path / "taught.v2"
    commands = "DO MOVE TRANS(450,150,0,90,90)", "DO BREAK", "HERE a", "TEACH #p", "POINT b = a:TRANS(,,10)"
    assert session("", *commands, f"STORE {file}") == [""] * 6
    answers = session("", f"LOAD {file}", "LISTL", "DELETEL a", "DELETEL a")
    assert answers[0] == "0 programs, 3 locations, 0 numbers"
    assert any(line.startswith("a 450.000 150.000 ") for line in answers[1].splitlines())
    assert answers[2:] == ["", "error: there is no location a"]


def test_signals_and_analogue_outputs_are_told() -> None:
    answers = session("", "IO", "DO SIGNAL 3, 2005", "DO DAC 1 = 2.5", "DO DAC 1 = 1.25", "IO")
    assert answers[0].splitlines()[-1] == "analogue none"
    assert [line.split(None, 1)[1] for line in answers[-1].splitlines()] == ["3", "none", "2005", "1 1.25 V"]


def test_where_tells_place_and_joints_of_the_arm() -> None:
    where = session("", "DO READY", "WHERE")[1]
    assert "o 0.00 a -90.00 t 90.00" in where  # the same as 90, -90, 0: the angles about z add up
    assert where.endswith("joints 0.00 -90.00 90.00 0.00 0.00 0.00")


def test_a_program_is_stepped_from_its_beginning() -> None:
    answers = session(main_program("x = 1", "x = 2"), "XSTEP main", "LISTR", "NEXT", "LISTR", "XSTEP main,x")
    assert answers[0] == "paused: at step 2 of program main"
    assert (answers[1], answers[3]) == ("x 1", "x 2")
    assert "expected XSTEP" in answers[4]


@pytest.mark.parametrize(
    ("line", "listed"),
    [("EXECUTE main,,2", "x 2"), ("EXECUTE main,2,", "x 4\ny 1"), ("EXECUTE main,", "x 2\ny 1")],
)
def test_cycles_and_step_that_are_left_out_are_one(line: str, listed: str) -> None:
    answers = session(main_program("y = 1", "x = x+2"), "DO x = 0", line, "LISTR")
    assert answers[1:] == ["completed", listed]


@pytest.mark.parametrize(
    "line",
    [
        *(
            "SPEED 0",
            "SPEED 1e-300",
            "SPEED nan",
            "EX",
            "LOAD",
            "EX main,0",
            "EX main,--1",
            "EX nobody",
            "EX main,x",
            "EX main,1,99",
            "LOAD missing.v2",
            "STORE",
            "DO GOTO 3",
        ),
        *(
            "HERE 3",
            "POINT a = 3",
            "LISTP nobody",
            "DELETER x",
            "NEXT",
            "RETRY",
            "DO FOO",
            "DELETEL (",
            "DELETEL a[i]",
            "DELETEL a[-1]",
            "DELETER x[1.5]",
            "HERE",
            "POINT",
        ),
    ],
)
def test_a_mistake_is_answered_and_ends_nothing(line: str) -> None:
    answers = session(main_program("x = 1"), line, "EX main")
    assert answers[0].startswith("error: ")
    assert answers[1] == "completed"


def test_signals_and_quit() -> None:
    answers = session("", "DO SIGNAL 3, 2001", "IO")
    assert answers[1].splitlines() == ["outputs  3", "inputs   none", "internal 2001", "analogue none"]
    with interpreter() as (run, _):
        monitor = ValMonitor(run)
        assert monitor.obey("QUIT") == ""
        assert monitor.over


def test_the_monitor_knows_that_the_arm_was_stopped_during_a_command() -> None:
    """Of a stop of the servo `test_val_interpreter.py` has the rest; here a mistake does it."""
    text = main_program("MOVE a", "MOVE b", rest=".LOCATIONS\na 450 150 0 90 90 0\nb 2000 0 0 90 90 0\n.END")
    with interpreter(text) as (run, _):
        monitor, stopped = ValMonitor(run), []
        for line in ("WHERE", "EX main", "WHERE", "RETRY", "FOO", "PROCEED"):
            monitor.obey(line)
            stopped.append(monitor.stopped)
    assert stopped == [False, True, False, True, False, False]


def test_places_and_numbers_are_listed_by_their_names() -> None:
    file = ".LOCATIONS\na 1 2 3 90 -90 0\nbox[1] 4 5 6 90 -90 0\nbox[2] 7 8 9 90 -90 0\n.END\n.REALS\nx 1\ny 2\n.END"
    answers = session(file, "LISTL a", "LISTL BOX", "LISTL box[2], a", "LISTL c", "LISTR y", "LISTR z")
    assert [line.split()[0] for line in answers[0].splitlines()] == ["a"]
    assert [line.split()[0] for line in answers[1].splitlines()] == ["box[1]", "box[2]"]
    assert [line.split()[0] for line in answers[2].splitlines()] == ["box[2]", "a"]
    assert answers[3:] == ["error: there is no location c", "y 2", "error: there is no number z"]


def test_an_element_is_deleted_by_its_number_alone() -> None:
    file = ".LOCATIONS\na 1 2 3 90 -90 0\na[1] 4 5 6 90 -90 0\n.END\n.REALS\ni 1\n.END"
    answers = session(file, "DELETEL a[i]", "DELETEL a[-1]", "LISTL", "DELETEL a[1]", "LISTL")
    assert answers[0] == answers[1] == "error: column 1: expected whole numbers from 0 to 1000000 as indices"
    assert [line.split()[0] for line in answers[2].splitlines()] == ["a", "a[1]"]
    assert [line.split()[0] for line in answers[4].splitlines()] == ["a"]


@pytest.mark.parametrize(
    ("place", "said"),
    [
        ("a 2000000 0 0 0 0 0", "line 6: 2e+06 is too large for a location"),
        ("#p 0 0 0 2000000 0 0", "line 6: 2e+06 is too large for a location"),
        ("a[-1] 1 2 3 90 -90 0", "line 6, column 1: expected whole numbers"),
        ("#p 0 -45 180 0 45", "location #p: puma560 has 6 joints, not 5"),
        ("#p 0 -45 180 0 45 0 0", "location #p: puma560 has 6 joints, not 7"),
        ("#p", "line 6, column 1: location #p: expected 6 numbers, not 0"),
    ],
)
def test_of_a_file_with_a_place_of_no_arm_nothing_is_taken(place: str, said: str, tmp_path: Path) -> None:
    file = tmp_path / "places.v2"
    file.write_text(f"{main_program('x = 2')}\n.LOCATIONS\n{place}\n.END")
    answers = session(main_program("x = 1"), f"LOAD {file}", "EX main", "LISTR", "LISTL")
    assert said in answers[0].replace(str(file), "places.v2")
    assert answers[1:] == ["completed", "x 1", ""]
    mistakes = check_text(file.read_text(), load_robot("puma560"))
    assert any(mistake.what in answers[0] for mistake in mistakes)


def test_a_file_loaded_over_a_program_that_is_paused_says_what_goes_on_as_it_was(tmp_path: Path) -> None:
    for name, value in (("old", 1), ("new", 2)):
        (tmp_path / f"{name}.v2").write_text(f".PROGRAM main\nPAUSE\nx = {value}\n.END\n")
    with interpreter() as (run, _):
        monitor = ValMonitor(run)
        assert monitor.obey(f"LOAD {tmp_path / 'old'}") == "1 programs, 0 locations, 0 numbers"
        monitor.obey("EX main")
        assert monitor.obey(f"LOAD {tmp_path / 'old'}") == "1 programs, 0 locations, 0 numbers"
        assert "what was begun of main goes on as it was" in monitor.obey(f"LOAD {tmp_path / 'new'}")
        monitor.obey("PROCEED")
        assert run.machine.values["x", ()] == 1.0
        monitor.obey("EX main")
        monitor.obey("PROCEED")
        assert run.machine.values["x", ()] == 2.0
