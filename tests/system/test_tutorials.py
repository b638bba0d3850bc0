"""The course of tutorials: complete, in step with its programs, and its commands work as they stand there."""

from __future__ import annotations

import re
import shlex
from itertools import pairwise
from pathlib import Path

import pytest

from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.rccl import DataBase
from qrobot.rccl.setpoints import read_setpoints

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "tutorials"
INDEX = (FOLDER / "index.md").read_text()
PAGES = [FOLDER / f"{name}.md" for name in INDEX.partition(":maxdepth: 1")[2].split() if name != "```"]
COURSE = [page for page in PAGES if re.match(r"# \d", page.read_text())]  # the others stand alone
GUIDES = [  # that have an example of their own
    ROOT / "docs" / "how-to" / f"{name}.md" for name in ("slow-down-and-pause", "lead-the-arm-by-hand", "real-time")
]
EXAMPLES = {str(path.relative_to(ROOT / "examples")): path.read_text() for path in (ROOT / "examples").rglob("*.py")}


def page_name(page: Path) -> str:
    return page.stem


def named(page: Path) -> list[str]:
    """Examples of a page, in their order."""
    return list(dict.fromkeys(re.findall(r"examples/((?:arcl/)?\w+\.py)", page.read_text())))


def test_seven_numbered_pages_lead_from_one_to_the_next() -> None:
    titles = [page.read_text().splitlines()[0] for page in COURSE]
    assert [title[:4] for title in titles] == [f"# {k}." for k in range(1, 8)]
    assert re.findall(r"^\| \[(.*?)\]", INDEX, re.MULTILINE) == [title[2:] for title in titles]
    for page, after in pairwise(COURSE):
        assert f"({after.name})" in page.read_text()


def test_every_example_has_its_page_and_a_test_that_runs_it() -> None:
    taught = [name for page in [*COURSE, *GUIDES] for name in named(page)]
    assert sorted(set(taught)) == sorted(
        name for name, text in EXAMPLES.items() if "rccl.control" in text or "qrobot.ident" in text
    )
    tests = "".join(path.read_text() for path in (ROOT / "tests").rglob("test_*.py"))
    assert [name for name in taught if name not in tests] == []


@pytest.mark.parametrize("page", PAGES, ids=page_name)
def test_the_lines_of_a_page_stand_in_its_programs(page: Path) -> None:
    programs = {line.strip() for name in named(page) for line in EXAMPLES[name].splitlines()}
    programs |= {line.strip() for line in EXAMPLES["07_guarded_approach.py"].splitlines()}  # has two pages
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL)
    assert [line for line in "".join(blocks).splitlines() if line.strip() not in programs] == []


def test_the_commands_of_the_page_on_teaching_work_one_after_the_other_off_line(tmp_path, monkeypatch, capsys) -> None:
    page = (FOLDER / "teaching.md").read_text()
    monkeypatch.chdir(tmp_path)
    script = re.search(r"echo '(.*?)' \| tr", page)
    assert script is not None
    Path("script.txt").write_text(script[1].replace(";", "\n"))
    Path("examples").symlink_to(ROOT / "examples")
    commands = re.findall(r"\.venv/bin/qrobot (.*)", page)
    for command in (command for command in commands if "--offline" in command):
        name, *words = shlex.split(command)
        words += ["--script", "script.txt"] if name == "teach" else []
        assert run_app(make_app(name), [name, *words]) == 0, capsys.readouterr().err
    said = capsys.readouterr().out
    assert "error" not in said
    assert DataBase("parts.db").names() == re.findall(r"at (\w+) after", said) == ["LEFT", "RIGHT"]
    replayed = [Path(word) for word in shlex.split(commands[-1]) if word.endswith(".csv")]
    assert [len(read_setpoints(path).q) > 50 for path in replayed] == [True]
