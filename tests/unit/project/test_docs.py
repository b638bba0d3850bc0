"""The pages: links lead somewhere, decision records have their form, generated parts are fresh."""

from __future__ import annotations

import ast
import re
import runpy
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from qrobot import rccl, rci
from qrobot.config import load_deployment, load_robot
from qrobot.rci import VirtualLink
from qrobot.wire import Hello
from tests.support.fake_robot import FakeRobot

ROOT = Path(__file__).parents[3]
PAGES = sorted(
    [*ROOT.glob("*.md"), *(path for path in (ROOT / "docs").rglob("*.md") if "_build" not in path.parts)],
)
RECORDS = sorted((ROOT / "docs/decisions").glob("0*.md"))
LINK = re.compile(r"\]\(([^)\s#]+)?(?:#([^)]*))?\)")
PROGRAM = re.compile(r"```(?:python|c)\n(.*?)```", re.DOTALL)
ADDRESS = re.compile(r'127\.0\.0\.1(?::|", *)(\d+)')
REFRESH = runpy.run_path(str(ROOT / "docs/refresh.py"))


def page_name(path: Path) -> str:
    return str(path.relative_to(ROOT))


def without_code(text: str) -> str:
    return re.sub(r"```.*?```|`[^`\n]*`", "", text, flags=re.DOTALL)


def anchors(text: str) -> set[str]:
    """Anchors of the headings, as Markdown renderers make them."""
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def broken_links(page: Path) -> list[str]:
    """Links of a page that lead to no file or to no heading of one."""
    broken = []
    for target, anchor in LINK.findall(without_code(page.read_text())):
        if re.match(r"https?:", target):
            continue
        file = page.parent / target if target else page
        if not file.exists() or (anchor and anchor not in anchors(file.read_text())):
            broken.append(f"{target}#{anchor}")
    return broken


def goes_down_by_one_level(page: Path) -> bool:
    """Headings of a page do, from its title on."""
    levels = [len(marks) for marks in re.findall(r"^(#+) ", without_code(page.read_text()), re.MULTILINE)]
    return levels[:1] == [1] and all(lower <= upper + 1 for upper, lower in pairwise(levels))


def missing_sources(page: Path) -> list[str]:
    """Source files that a page names and that are not there."""
    named = re.findall(r"\b((?:qrobot|tests|docs|config|examples)/[\w./-]*\w\.(?:py|toml|md))", page.read_text())
    return [name for name in named if not (ROOT / name).is_file()]


def has_its_form(record: Path) -> bool:
    """A decision record gives question, choice and costs on one page."""
    text = record.read_text()
    return (
        re.findall(r"^## (.*)$", text, re.MULTILINE) == ["Question", "Choice", "Costs"]
        and bool(re.match(rf"# {int(record.name[:4])}\. \S.*\n\nDate: \d{{4}}-\d\d-\d\d\n", text))
        and text.count("\n") <= 60
    )


def test_links_of_a_page_lead_to_a_file_and_a_heading() -> None:
    assert [(page_name(page), link) for page in PAGES for link in broken_links(page)] == []


def test_headings_of_a_page_go_down_by_one_level_from_its_title() -> None:
    """As the pages are built, where a warning is an error."""
    assert [page_name(page) for page in PAGES if not goes_down_by_one_level(page)] == []


def test_source_files_named_on_a_page_exist() -> None:
    assert [(page_name(page), name) for page in PAGES for name in missing_sources(page)] == []


def test_programs_on_pages_reach_bridges_of_the_deployment_files_of_the_package() -> None:
    bridges = {arm.bridge.port for path in (ROOT / "config").glob("*.toml") for arm in load_deployment(path).arm}
    found = {
        (page_name(page), int(port))
        for page in PAGES
        for program in PROGRAM.findall(page.read_text())
        for port in ADDRESS.findall(program)
    }
    assert len(found) >= 3
    assert {each for each in found if each[1] not in bridges} == set()


def test_a_decision_record_gives_question_choice_and_costs_on_one_page() -> None:
    assert [page_name(record) for record in RECORDS if not has_its_form(record)] == []


def test_each_decision_record_has_a_number_of_its_own() -> None:
    numbers = [int(record.name[:4]) for record in RECORDS]
    assert numbers == sorted(set(numbers))


@pytest.mark.parametrize("name", sorted(REFRESH["PAGES"]))
def test_generated_parts_of_a_reference_page_are_fresh(name: str) -> None:
    page = (ROOT / "docs" / name).read_text()
    assert REFRESH["PAGES"][name](page) == page


@pytest.mark.parametrize(
    ("part", "wanted"),
    [
        ("modes", "    HOLDING --> TRACKING: "),
        ("faults", "| 22 | GUARD_TRIP | 0 | yes |"),
        ("laws", "| `qrobot` (default) | "),
        ("registers", "| 0x2c | 1 | 16 | ADC_MUX | "),
        ("telemetry", "| `q` | float64[n] | measured position, rad or m |"),
        ("command-line", "### qrobot log export"),
        ("deployment-keys", "| `rate_hz` | whole number from 100 to 10000 | `1000` |"),
        ("robot-keys", "| `brake` | n of true or false | needed |"),
        ("robot-keys", "| `vendor_rad_per_count` | n numbers other than zero | - |"),
    ],
)
def test_a_stale_part_is_made_anew_from_the_code(part: str, wanted: str) -> None:
    page = REFRESH["rewrite"](f"before\n<!-- generated: {part} -->\nold\n<!-- end -->\nafter\n")
    assert "old" not in page.splitlines()
    assert wanted in page
    assert page.startswith("before\n")
    assert page.endswith("<!-- end -->\nafter\n")


def test_every_part_is_on_a_page() -> None:
    text = "".join((ROOT / "docs" / name).read_text() for name in REFRESH["PAGES"])
    assert [part for part in REFRESH["PARTS"] if f"<!-- generated: {part} -->" not in text] == []


@pytest.mark.parametrize("name", ["README.md", "docs/how-to/write-a-program.md", "docs/how-to/write-an-rci-task.md"])
def test_a_program_printed_on_a_page_runs_as_it_is(name: str) -> None:
    program = re.search(r"```python\n(.*?)```", (ROOT / name).read_text(), re.DOTALL)
    assert program is not None
    robot = FakeRobot(tuple(load_robot("puma560").poses["park"]))

    def links(hello: Hello) -> VirtualLink:
        return VirtualLink(hello, robot.transfer)

    with rccl.use(links), rci.use(links):
        exec(compile(program[1], name, "exec"), {})
    assert robot.goodbyes
    assert np.ptp(robot.path, axis=0).max() > 0.5  # it did move


def test_signatures_are_such_as_the_pages_of_modules_can_show() -> None:
    """Those in which an annotation has an f-string are a warning there, and a warning is an error."""
    found = [
        f"{path.relative_to(ROOT)}:{part.lineno}"
        for path in sorted((ROOT / "qrobot").rglob("*.py"))
        for function in ast.walk(ast.parse(path.read_text()))
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef)
        for part in ast.walk(function.args)
        if isinstance(part, ast.JoinedStr)
    ]
    assert found == []
