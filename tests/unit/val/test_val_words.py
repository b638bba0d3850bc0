"""The words that the page of VAL II names: each is there, or is refused by its name."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from qrobot.errors import ProgramError
from qrobot.val import number_ranges
from qrobot.val.monitor import HELP
from qrobot.val.parser import parse_line
from qrobot.val.vocabulary import (
    INSTRUCTIONS,
    LOCATION_CHANGES,
    LOCATION_FUNCTIONS,
    LOCATION_VALUES,
    NUMBER_FUNCTIONS,
    NUMBER_VALUES,
    RESERVED,
    UNSUPPORTED_FUNCTIONS,
)

PAGE = (Path(__file__).parents[3] / "docs/reference/val.md").read_text()
KNOWN = {*RESERVED, *NUMBER_FUNCTIONS, *LOCATION_FUNCTIONS, *LOCATION_CHANGES, *INSTRUCTIONS}
KNOWN |= {"SIG"} | {word.upper() for word in (*LOCATION_VALUES, *NUMBER_VALUES)}
REFUSED = re.search(r"Each is refused by name: `([A-Z ]+)`", PAGE.replace("\n", " "))
ASTERISKED = (  # of the list of words that the language was made after
    "MOVE MOVES APPRO APPROS DEPART DEPARTS DRIVE ALIGN READY DELAY BREAK BRAKE OPEN OPENI CLOSE CLOSEI SPEED RIGHTY "
    "LEFTY ABOVE BELOW FLIP NOFLIP COARSE FINE NULL NONULL PARAMETER ENABLE DISABLE SET HERE TOOL BASE #PPOINT TRANS "
    "FRAME INVERSE SHIFT DEST IF THEN ELSE END WHILE DO UNTIL FOR TO STEP CASE VALUE ANY GOTO CALL RETURN PAUSE STOP "
    "HALT WAIT REACT REACTI REACTE IGNORE LOCK SIGNAL SIG RESET TYPE PROMPT TIMER"
)
COMMANDS = "EXECUTE DO ABORT PROCEED RETRY NEXT HERE WHERE POINT TEACH LISTL LISTP LISTR DELETEL DELETEP DELETER LOAD "
COMMANDS += "STORE SPEED IO STATUS CALIBRATE"


def _section(title: str) -> str:
    return PAGE.partition(f"\n## {title}\n")[2].partition("\n## ")[0]


def test_every_word_of_the_language_is_known_and_on_the_page() -> None:
    words = ASTERISKED.split()
    assert [word for word in words if word not in KNOWN] == []
    assert [word for word in words if not re.search(rf"(?<![A-Z.]){word}(?![A-Z.])", PAGE)] == []


@pytest.mark.parametrize("title", ["Motions", "Locations and numbers", "Flow", "Signals and events"])
def test_every_word_in_a_section_of_the_page_is_known(title: str) -> None:
    code = " ".join(re.findall(r"`([^`]+)`", _section(title)))
    words = set(re.findall(r"(?<![\w.])[A-Z][A-Z0-9.]+(?![\w.])", code))
    assert words - KNOWN - set(HELP) - {"MMPS", "ALWAYS", "OF", "BY", "HAND.TIME", "PPOINT"} == set()


def test_every_constant_is_on_the_page_as_a_word_that_takes_no_value() -> None:
    assert [word for word in NUMBER_VALUES if f"`{word.upper()}`" not in _section("Locations and numbers")] == []


@pytest.mark.parametrize(
    ("title", "pattern", "end"),
    [
        ("Motions", r"`SPEED n .*above 0 and up to (\d+)", number_ranges.SPEED_MMPS.most),
        ("Motions", r"`SPEED n .*per cent, 0.1 to (\d+)", number_ranges.SPEED.most),
        ("Signals and events", r"timers are 0 to (\d+)", number_ranges.TIMER.most),
        ("Terminal", r"`PARAMETER HAND.TIME = s` \(0 to (\d+)\)", number_ranges.PARAMETER_RANGES["HAND.TIME"].most),
        ("Terminal", r"torques in the robot file, 1 to (\d+)", number_ranges.PARAMETER_RANGES["COLLISION"].most),
        ("Terminal", r"before the program pauses: 0 to (\d+)", number_ranges.PARAMETER_RANGES["RETRACT"].most),
    ],
)  # fmt: skip
def test_numbers_that_a_step_takes_end_where_the_page_says(title: str, pattern: str, end: float) -> None:
    found = re.search(pattern, _section(title))
    assert found is not None
    assert float(found[1]) == end


def test_every_command_of_the_monitor_is_there_and_on_the_page() -> None:
    commands = _section("Monitor")
    assert set(COMMANDS.split()) <= set(HELP)
    assert [command for command in HELP if f"`{command}" not in commands and f", `{command}" not in commands] == []


def test_what_the_page_calls_not_supported_is_refused_by_name() -> None:
    assert REFUSED is not None
    for word in REFUSED[1].split():
        line = f"x = {word}(1)" if word in UNSUPPORTED_FUNCTIONS else f"{word} 1"
        with pytest.raises(ProgramError, match=word):
            parse_line(line)
