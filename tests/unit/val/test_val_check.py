"""`check_text`: mistakes of VAL II programs that can be seen before anything moves."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.cli.arms import choose_arm
from qrobot.config import load_robot
from qrobot.config.fences import Fence
from qrobot.fences.fence_set import FenceSet
from qrobot.val.check import check_text
from qrobot.val.signal_lines import SignalLines, signal_lines_of
from qrobot.val.values import numbers_of, transformation
from qrobot.val.vocabulary import LOCATION_VALUES, NUMBER_VALUES
from qrobot.val.workspace import Workspace
from tests.support.drawn_arms import drawn, within
from tests.support.val_runs import EXAMPLES, main_program

ROBOT = load_robot("puma560")
PLACES = """
.LOCATIONS
near 450 0 0 90 90 0
far 2000 0 0 90 90 0
#bent 0 0 0 0 170 0
.END
.REALS
count 0
.END
"""


@pytest.mark.parametrize("file", sorted(EXAMPLES.glob("*.v2")), ids=lambda file: file.stem)
def test_the_examples_have_no_mistakes(file) -> None:
    assert check_text(file.read_text(), ROBOT) == []


@pytest.mark.parametrize(
    ("line", "column", "said"),
    [
        ("MOVE far", 6, "does not reach"),
        ("MOVES SHIFT(near BY 2000)", 7, "does not reach"),
        ("APPRO near, 3000", 7, "does not reach"),
        ("MOVE #bent", 6, "does not reach"),
        ("MOVE #PPOINT(0, 0, 0, 0, 170, 0)", 6, "does not reach"),
        ("HERE base", 1, "BASE is a word of VAL and cannot be given a value: choose another name"),
        ("pi = 3", 1, "PI is a word of VAL"),
        ("random = 3", 1, "RANDOM is a word of VAL"),
        ("HERE (near)", 7, "expected the name of a location"),
        ("x = 1+(near)", 8, "expected a number, not a location"),
        ("DECOMPOSE tool[] = near", 1, "TOOL is a word of VAL"),
        ("CALL nobody", 6, "there is no program nobody"),
        ("CALL main(3)", 6, "has 0 parameters, not 1"),
        ("REACTI 1001, nobody", 14, "there is no program nobody"),
        ("PCEXECUTE nobody", 11, "there is no program nobody"),
        ("SIGNAL 17", 1, "there is no signal 17"),
        ("SIGNAL 1001", 1, "is an input"),
        ("x = SIG(-1033)", 1, "there is no signal 1033"),
        ("WAIT SIG(3000)", 1, "there is no signal 3000"),
        ("DAC 9 = 1", 1, "there is no analogue output 9; there are 1 to 8"),
        ("DAC 1.5 = 1", 1, "there is no analogue output 1.5"),
        ("SIGNAL -1.5", 1, "a signal is a whole number, not 1.5"),
        ("GOTO 10", 6, "there is no label 10"),
        ("x = near", 5, "expected a number, not a location"),
        ("TYPE /F8.2, 2, near", 16, "expected a number, not a location"),
        ("WAIT 1 == near+2", 11, "expected a number, not a location"),
        ("MOVE count", 6, "expected a location, not a number"),
        ("SET a = SHIFT(count BY 1)", 15, "expected a location, not a number"),
        ("SPEED 0.05", 1, "SPEED: 0.1 to 1000 per cent is needed, not 0.05"),
        ("SPEED -5 MMPS ALWAYS", 1, "above 0 and up to 1000 is needed, not -5"),
        ("DELAY 1E9", 1, "expected 0 to 86400 seconds"),
        ("MOVE #PPOINT(0, 0)", 6, "#PPOINT: puma560 has 6 joints, not 2"),
        ("SET a = #PPOINT(count, 0, 0, 0, 0, 0, 0):near", 9, "#PPOINT: puma560 has 6 joints, not 7"),
        ("MOVE #PPOINT()", 6, "#PPOINT: expected 1 or more arguments, not 0"),
        ("DRIVE 7, 10, 50", 1, "joints are 1 to 6, not 7"),
        ("DRIVE 1, 10, 0", 1, "SPEED: 0.1 to 1000 per cent is needed, not 0"),
        ("PCEXECUTE main, 0", 1, "cycles: expected 1 or more, or a negative number for a program without end"),
        ("SET not = HERE", 1, "NOT is a word of VAL and cannot be given a value: choose another name"),
        ("TIMER 16 = 0", 1, "timers are 0 to 15, not 16"),
        ("PARAMETER HAND.TIME = 61", 1, "HAND.TIME is 0 to 60 s"),
        ("PARAMETER COLLISION = 0", 1, "COLLISION is 1 to 100 per cent"),
        ("PARAMETER RETRACT = 301", 1, "RETRACT is 0 to 300 mm"),
        ("x = 1/0", 6, "1 / 0 is no number"),
        ("x = SQRT(-4)", 5, "SQRT of -4 is no number"),
        ("x = BITS(2001, 17)", 1, "BITS takes 1 to 16 signals"),
        ("    SIGNAL 17", 5, "there is no signal 17"),
        ("MOVE nowhere", 6, "nowhere has no value"),
        ("  x = 3 + many[2]", 11, "many has no value"),
        ("10 UNTIL TRUE", 4, "UNTIL without DO"),
        ("  WHILE TRUE DO", 3, "expected END for this WHILE"),
        ("MOVE near far", 11, "'far' stands there"),
    ],
)
def test_a_mistake_is_told_with_line_and_column(line: str, column: int, said: str) -> None:
    mistakes = check_text(main_program("; a comment", line, rest=PLACES), ROBOT)
    assert [(mistake.line, mistake.column) for mistake in mistakes] == [(3, column)]
    assert said in mistakes[0].what


@pytest.mark.parametrize(
    ("line", "column", "said"),
    [
        ("y = a", 5, "expected a number, not a location"),
        ("y = 1+(b)", 8, "expected a number, not a location"),
        ("SET c = SHIFT(near BY a)", 23, "expected a number, not a location"),
        ("MOVE c[a]", 8, "expected a number, not a location"),
        ("x = DX(i)", 8, "expected a location, not a number"),
        ("MOVE near:x", 11, "expected a location, not a number"),
        ("MOVES d[1]", 7, "expected a location, not a number"),
        ("FOR i = 1 TO a", 14, "expected a number, not a location"),
    ],
)
def test_a_name_that_the_program_gives_values_of_one_kind_alone_is_of_that_kind(
    line: str, column: int, said: str
) -> None:
    given = "SET a = TRANS(1,2,3)", "HERE b", 'PROMPT "x", x', "SET c[1] = a", "DECOMPOSE d[] = a"
    loop = [] if line.startswith("FOR") else ["FOR i = 1 TO 2"]
    mistakes = check_text(main_program(*given, *loop, line, "END", rest=PLACES), ROBOT)
    assert [(mistake.line, mistake.column, mistake.what) for mistake in mistakes] == [
        (len(given) + len(loop) + 2, column, said)
    ]


@pytest.mark.parametrize(
    ("before", "line"),
    [
        (("SET a = near", "MOVE a", "a = 3"), "y = a"),
        (("SET near = TRANS(1)", "near = 1"), "y = near"),
        (("SET a[1] = near", "a[2] = 3"), "y = a[2]"),
        (("SET a = near", "CALL other(a)"), "y = a"),
        (("SET p = near",), "y = p"),
    ],
)
def test_a_name_that_may_be_a_number_or_a_location_is_for_the_run_to_tell(before: tuple[str, ...], line: str) -> None:
    other = ".PROGRAM other(p)\n    p = 1\n.END\n"
    assert check_text(main_program(*before, line, rest=other + PLACES), ROBOT) == []


@pytest.mark.parametrize("seed", range(6))
def test_places_are_looked_at_for_an_arm_without_a_closed_form(seed: int) -> None:
    random, robot = np.random.default_rng(seed), drawn(seed)
    space = Workspace(robot)
    reached = [numbers_of(space.tool_at(within(robot, random.uniform(0.02, 0.98, 6)))) for _ in range(4)]
    stored = [f"p{k} " + " ".join(map(str, numbers)) for k, numbers in enumerate(reached)]
    places = "\n".join([".LOCATIONS", *stored, "far 9000 0 0 90 90 0", ".END"])
    mistakes = check_text(main_program(*(f"MOVE p{k}" for k in range(4)), "MOVE far", rest=places), robot)
    assert [(each.line, each.what) for each in mistakes] == [(6, "MOVE: the arm does not reach this place")]


@pytest.mark.parametrize("word", sorted({*LOCATION_VALUES, *NUMBER_VALUES}))
def test_a_stored_value_and_a_parameter_that_are_called_like_a_word_are_mistakes(word: str) -> None:
    lines = "MOVE near", ".END", f".PROGRAM go(x, {word.upper()})", ".END", ".LOCATIONS", f"{word}[1] 0 0 100 90 -90 0"
    text = main_program(*lines, ".END", ".REALS", f"{word} 5", rest=PLACES)
    told = f"{word.upper()} is a word of VAL and cannot be given a value: choose another name"
    found = [(mistake.line, mistake.what) for mistake in check_text(text, ROBOT)]
    assert found == [(4, told), (7, told), (10, told)]


@pytest.mark.parametrize(
    "lines",
    [
        ("MOVE near",),
        ('PROMPT "n", n', "SIGNAL n"),
        ("SET far = near", "MOVE far"),
        ("BASE 1600", "MOVE far"),
        ("MOVE HERE:far",),
        ("IF count > 0 THEN", "SPEED count", "DELAY -count", "x = 1/count", "END"),
        ("x = DZ(near)", "TYPE DISTANCE(near, far), TIMER(1), SIG(2001)", "DECOMPOSE y[] = near"),
        ("DRIVE 1, -500, 1000", "TIMER 15 = -3", "PARAMETER HAND.TIME = 60"),
    ],
)
def test_what_only_a_run_can_tell_is_no_mistake(lines: tuple[str, ...]) -> None:
    assert check_text(main_program(*lines, rest=PLACES), ROBOT) == []


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("SIGNAL -3", "output 3 is not configured; the deployment file has 1: add it to"),
        ("x = SIG(1, 3)", "output 3 is not configured"),
        ("RUNSIG 2", "output 2 is not configured"),
        ("WAIT SIG(1007)", "no line leads to input 1007; the board's are 1001 to 1006"),
        ("REACTI 1008, main", "no line leads to input 1008"),
        ("IF SIG(1001, 1006, 2032) THEN", None),
        ("SIGNAL 1, 2001", None),
    ],
)
def test_a_signal_without_a_line_is_told_once_where_the_lines_are_known(line: str, said: str | None) -> None:
    deployed = choose_arm(str(EXAMPLES / "06_process_control.toml"), None)
    text = main_program(line, *(["END"] if line.endswith("THEN") else []), line if said else "")
    mistakes = check_text(text, ROBOT, lines=signal_lines_of(deployed))
    assert [mistake.line for mistake in mistakes] == ([] if said is None else [2])
    assert all(str(said) in mistake.what for mistake in mistakes)
    assert check_text(text, ROBOT) == []


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("DAC 2 = 1", "analogue output 2 is not configured; the deployment file has 1: add it to"),
        ("DAC 1 = 5.5", "analogue output 1: 5.5 V is not within 0 to 5 V"),
        ("DAC 1 = -1E9", "analogue output 1: -1e+09 V is not within 0 to 5 V"),
        ("DAC 1 = 5", ""),
        ("DAC 1 = RANDOM()", ""),
        ("DAC 1 = random", ""),
    ],
)
def test_volts_that_an_analogue_output_does_not_show_are_told(line: str, said: str) -> None:
    mistakes = check_text(main_program(line), ROBOT, lines=SignalLines(frozenset(), {1: (0.0, 5.0)}))
    assert [mistake.what[: len(said)] for mistake in mistakes] == ([said] if said else [])
    assert check_text(main_program(line), ROBOT) == []


def test_a_process_control_program_that_would_move_is_told_with_all_that_it_calls() -> None:
    others = ".PROGRAM p\n CALL q\n.END\n.PROGRAM q\n  DELAY 1\n.END\n.PROGRAM r\nREADY\n.END"
    mistakes = check_text(main_program("PCEXECUTE p", "CALL r", rest=others), ROBOT)
    assert [(mistake.program, mistake.line, mistake.column) for mistake in mistakes] == [("q", 9, 3)]
    assert "moves nothing; to wait there: TIMER 1 = 0" in mistakes[0].what


def test_names_without_a_value_are_told_once_each_and_when_all_lines_can_be_read() -> None:
    lines = "MOVE nowhere", "MOVE nowhere"
    assert [mistake.line for mistake in check_text(main_program(*lines), ROBOT)] == [2]
    assert [mistake.line for mistake in check_text(main_program(*lines, "SET nowhere ="), ROBOT)] == [4]


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("MOVE low", "MOVE: "),
        ("APPROS near, -310", "APPROS: "),
        ("MOVE #down", "MOVE: wrist would be"),
        ("MOVE near", ""),
    ],
)
def test_a_constant_place_past_a_fence_is_told(line: str, said: str) -> None:
    bench = FenceSet(ROBOT, [Fence(name="bench", shape="plane", position_m=(0.0, 0.0, -0.3))])
    places = ".LOCATIONS\nnear 450 0 0 90 90 0\nlow 450 0 -320 90 90 0\n#down 0 30 180 0 45 0\n.END"
    mistakes = check_text(main_program(line, rest=places), ROBOT, bench)
    assert bool(mistakes) == bool(said)
    assert all(said in mistake.what and "fence 'bench'" in mistake.what for mistake in mistakes)
    assert check_text(main_program(line, rest=places), ROBOT) == []


def test_a_place_that_is_free_in_one_configuration_is_no_mistake() -> None:
    ways = Workspace(ROBOT).ways_to(transformation((500.0, 0.0, 200.0, 45.0, 0.0, 0.0)))
    elbows = [FenceSet(ROBOT, []).capsules_at(q)[3][1] for q in ways]
    each = [
        Fence(name=f"box{k}", shape="box", size_m=(0.02, 0.02, 0.02), position_m=tuple(elbow))
        for k, elbow in enumerate(elbows)
    ]
    program = main_program("MOVE high", rest=".LOCATIONS\nhigh 500 0 200 45 0 0\n.END")
    assert check_text(program, ROBOT, FenceSet(ROBOT, each[:1])) == []
    assert len(check_text(program, ROBOT, FenceSet(ROBOT, each))) == 1
