"""What the code has and a page lists, each is there: requests, laws, codes, calls, extras, keys, bits, options."""

from __future__ import annotations

import re
import runpy
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel, TypeAdapter

from qrobot import errors
from qrobot.config.deployment import Deployment
from qrobot.config.robot import Robot
from qrobot.extras import EXTRAS
from qrobot.faultcodes import FaultCode, explain
from qrobot.motion.event import Termination
from qrobot.servo.laws.shipped import LAWS
from qrobot.servo.modes import StopCategory
from qrobot.servo.operator.messages import OperatorRequest
from qrobot.servo.stop_categories import stop_category
from qrobot.wire import layout
from qrobot.wire.vocabulary import FLAG_MEANING, Request, RobotFlag

ROOT = Path(__file__).parents[3]
DOCS = ROOT / "docs"
REFRESH = runpy.run_path(str(DOCS / "refresh.py"))
KEYS = REFRESH["file_keys"]
COMMAND_LINE = (DOCS / "reference/command-line.md").read_text()
ALL_PAGES = "\n".join(path.read_text() for path in DOCS.rglob("*.md") if not {"_build", "decisions"} & {*path.parts})
CODES = "|".join(code.name for code in FaultCode)


def page(name: str) -> str:
    return (DOCS / name).read_text()


def section(text: str, heading: str) -> str:
    """What stands below a heading, to the next one of its rank."""
    rank = heading.split(maxsplit=1)[0]
    return text.partition(f"\n{heading}\n")[2].partition(f"\n{rank} ")[0]


def test_the_page_of_the_control_socket_has_every_request_with_its_fields() -> None:
    listed = section(page("how-to/operate-the-servo.md"), "## From a program")
    for request in get_args(get_args(OperatorRequest)[0]):
        fields = request.model_fields
        assert f'"{fields["command"].default}"' in listed
        assert [name for name in fields if f'"{name}": ' not in listed] == []


def test_every_option_for_a_law_names_them_all() -> None:
    listed = re.findall(r"`: (.*) or your own as path/to/file\.py:name", COMMAND_LINE)
    complete = [names for names in listed if "..." not in names]
    assert len(complete) == 4  # of ctl law, servo, run and demo
    for names in complete:
        assert set(LAWS) <= set(re.findall(r"[\w+-]+", names))


def test_every_option_of_the_command_line_has_words_and_no_opposite_that_is_so_anyway() -> None:
    options = re.findall(r"^\* (`.*?`):(.*)$", COMMAND_LINE, re.MULTILINE)
    assert len(options) > 300
    assert [name for name, words in options if not re.sub(r"\*+\[[^]]*\]\*+", "", words).strip()] == []
    assert set(re.findall(r"--(?:no|empty)-[a-z-]+", "".join(name for name, _ in options))) == {"--no-tracking"}
    assert "[default: ]" not in COMMAND_LINE


def test_codes_in_what_a_program_prints_are_those_of_the_code() -> None:
    quoted = re.findall(rf"\b({CODES}): ([^\n]*?); \.\.\.", ALL_PAGES)
    assert len(quoted) >= 2
    assert [each for each in quoted if not explain(FaultCode[each[0]]).startswith(f"{each[0]}: {each[1]}; ")] == []


def test_what_pages_say_of_the_stop_behind_a_code_is_its_stop_category() -> None:
    cut = {code.name for code in FaultCode if stop_category(code) is StopCategory.CATEGORY_0}
    assert [name for name in re.findall(rf"\b({CODES})\b,? (?:a|in a) controlled stop", ALL_PAGES) if name in cut] == []
    events = re.findall(rf"\b({CODES}): [^\n]*\n[^\n]* TRACKING -> (\w+)", ALL_PAGES)
    assert events
    assert [(name, mode) for name, mode in events if (mode == "FAULT") != (name in cut)] == []


def test_every_way_a_motion_can_fail_has_its_number_among_those_of_c() -> None:
    codes = section(page("reference/c-surface.md"), "## Codes")
    assert [each.name for each in Termination if each < Termination.NONE and f"{each.value} " not in codes] == []


def test_every_request_and_flag_of_the_wire_has_its_bit_and_its_meaning() -> None:
    (field,) = (field for field in layout.COMMAND.fields if field.name == "requests")
    assert [int(number) for number in re.findall(r"\d+", field.meaning)] == [each.value for each in Request]
    assert set(FLAG_MEANING) == set(RobotFlag)


def test_every_extra_stands_in_the_table_of_the_installation() -> None:
    table = section(page("how-to/install.md"), "## What is needed for what")
    assert sorted({extra.name for extra in EXTRAS.values() if f"| `{extra.name}` |" not in table}) == []


def test_every_call_of_the_header_for_c_stands_in_its_table() -> None:
    header = (ROOT / "qrobot/wire/c/qrobot_wire.h").read_text()
    calls = re.findall(r"^static inline .*?\b(qrobot_\w+)\(", header, re.MULTILINE)
    assert len(calls) > 15
    table = section(page("how-to/connect-an-existing-rccl.md"), "## What is in the header")
    named = {name if name[-1] != "_" else f"{name}..." for name in re.findall(r"`(qrobot_\w+)", table)}
    assert {call for call in calls if call not in named and not call.startswith("qrobot_put_")} == set()
    assert "qrobot_put_..." in named


def test_the_tree_of_errors_in_the_docstring_is_the_tree_of_errors() -> None:
    tree = (errors.__doc__ or "").splitlines()
    names = [found[1] for line in tree if (found := re.search(r"── (\w+)", line))]
    assert sorted(names) == sorted(each.__name__ for each in _below(errors.QRobotError))


def _below(error: type[Exception]) -> Iterator[type[Exception]]:
    for each in error.__subclasses__():
        if each.__module__ == errors.__name__:
            yield each
        yield from _below(each)


def test_words_and_numbers_that_a_page_allows_for_a_key_are_taken() -> None:
    tried = [each for model in (Deployment, Robot) for each in _choices(model)]
    assert {"kind", "adc_idle"} <= {key for key, _, _ in tried}
    for key, choice, said in tried:
        first = re.search(r"`([^`]*)`", said)
        assert first is not None, key
        TypeAdapter(choice).validate_json(first[1], strict=True)


def _choices(model: type[BaseModel]) -> Iterator[tuple[str, Any, str]]:
    """The keys, here and below, whose value is one of several, with what the page says of each."""
    for key, field in KEYS._fields(model):
        if (inner := KEYS._inner(field)) is not None:
            yield from _choices(inner)
        for kind in (field.annotation, *get_args(field.annotation)):
            if get_origin(kind) is Literal:
                yield key, kind, KEYS._describe(model, key, field)
