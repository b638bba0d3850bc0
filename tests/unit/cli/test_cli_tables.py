"""Tables lose nothing: not in a pipe, and not on a terminal of 80 columns, or of 20. Lines to copy work as they are."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import pytest
from rich.table import Table

from qrobot.cli.console import command_name, out, plain_table, print_table

ROOT = Path(__file__).parents[3]
NUMBERS = [f"{number * 1.2345e5:.3f}" for number in range(1, 13)]
PROSE = "what a terminal that is too narrow wraps between words, and a pipe not at all " * 3
PATH = "/a/rather/long/path/without/any/blank/in/it/[of]/a/log/called/puma560-20261122T191500Z.mcap"


def a_table() -> Table:
    table = plain_table("a title", "joint", *(f"column {number}" for number in range(12)), "text", words=["text"])
    table.add_row("shoulder_rotation", *NUMBERS, f"{PATH} {PROSE}")
    return table


def test_a_pipe_takes_a_row_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    print_table(a_table())
    title, _, row = capsys.readouterr().out.splitlines()
    assert title == "a title"
    assert row.split() == ["shoulder_rotation", *NUMBERS, PATH, *PROSE.split()]


@pytest.mark.parametrize("columns", [20, 80, 200])
def test_a_narrow_terminal_cuts_no_word_and_no_number(
    columns: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(out, "_force_terminal", True)
    monkeypatch.setattr(out, "_environ", {**os.environ, "TERM": "dumb"})
    monkeypatch.setattr(out, "_width", columns)
    print_table(a_table())
    words = set(re.sub(r"\x1b\[[0-9;]*m", "", capsys.readouterr().out).split())
    assert {"shoulder_rotation", *NUMBERS, PATH, *PROSE.split()} <= words


def test_no_command_prints_a_table_in_another_way() -> None:
    for path in set((ROOT / "qrobot" / "cli").glob("*.py")) - {ROOT / "qrobot" / "cli" / "console.py"}:
        assert not re.search(r"\b(out|err)\.print\((table|_table|_joints|errors)", path.read_text()), path


def test_a_name_with_brackets_is_printed_as_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    out.print("figure out/[red]x[/red].png")
    assert capsys.readouterr().out == "figure out/[red]x[/red].png\n"
    assert out.file is sys.stdout


@pytest.mark.parametrize(
    ("installed", "found", "line"),
    [
        (".venv/bin", None, ".venv/bin/qrobot"),
        ("../elsewhere/bin", None, "{above}/elsewhere/bin/qrobot"),
        (".venv/bin", ".venv/bin/qrobot", "qrobot"),
        (".venv/bin", "other/bin/qrobot", ".venv/bin/qrobot"),  # of another installation
        (None, None, "qrobot"),
    ],
)
def test_a_line_to_copy_calls_the_program_as_a_terminal_finds_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, installed: str | None, found: str | None, line: str
) -> None:
    here = tmp_path / "here"
    for each in (f"{installed}/qrobot" if installed else None, "other/bin/qrobot"):
        if each is not None:
            (here / each).parent.mkdir(parents=True, exist_ok=True)
            (here / each).touch()
    monkeypatch.chdir(here)
    monkeypatch.setattr("sysconfig.get_path", lambda _: os.path.normpath(here / (installed or "nowhere")))
    monkeypatch.setattr("shutil.which", lambda _: None if found is None else str(here / found))
    assert command_name() == line.format(above=tmp_path)
