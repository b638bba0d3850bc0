"""A remedy that names a command names one that exists."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from cyclopts import App

from qrobot.cli.main import make_app
from qrobot.faultcodes import EXPLANATION, FaultCode

ROOT = Path(__file__).parents[3]
NAMED = re.compile(r"`{1,2}qrobot ([^`]+)`")
TYPED = re.compile(r"^(?:\$ )?(?:\.venv/bin/)?qrobot ((?:[^\n]*\\\n)*[^\n]*)", re.MULTILINE)  # a line of a console
TEXTS = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "qrobot").rglob("*.py")),
]
APP = make_app()


def commands_in(path: Path) -> list[str]:
    """Commands between backticks, and on pages those of a console, each once; a value to be filled in is an X."""
    text = path.read_text()
    found = NAMED.findall(text)
    if path.suffix == ".md":
        lines = [line.replace("\\\n", " ").strip() for line in TYPED.findall(text)]
        found += [re.split(r" #|\s{2,}[a-z]", line)[0].rstrip(" &") for line in lines]  # remarks
    return sorted({" ".join(re.sub(r"\{[^}]*\}", "X", words).split()) for words in found})


NAMED_IN = [(path, command) for path in TEXTS for command in commands_in(path)]


def resolve(app: App, words: list[str]) -> App:
    """The subcommand that `words` lead to; raises KeyError at a word that is none where there are only subcommands."""
    while words and words[0] in list(app) and not words[0].startswith("-"):
        app, words = app[words[0]], words[1:]
    if words and app.default_command is None and not words[0].startswith("-"):
        raise KeyError(words[0])
    return app


def options_of(app: App) -> set[str]:
    """Names of a command's options."""
    own = app.assemble_argument_collection() if app is not APP and app.default_command is not None else ()
    return {"--help", "--version"} | {name for argument in own for name in argument.names}


def is_command(words: list[str]) -> bool:
    """There is a command of these words, and it has their options."""
    try:
        app = resolve(APP, words)
    except KeyError:
        return False
    options = {word.partition("=")[0] for word in words if word.startswith("--")}
    return not options or options <= options_of(app)


def test_every_command_that_a_text_names_exists() -> None:
    assert len(NAMED_IN) > 600
    assert [(str(path), command) for path, command in NAMED_IN if not is_command(shlex.split(command))] == []


@pytest.mark.parametrize("code", FaultCode)
def test_a_fault_is_cleared_by_the_word_that_clears_it(code: FaultCode) -> None:
    assert not re.search(r"\breset\b", " ".join(EXPLANATION[code]))


def test_advice_to_release_brakes_says_first_that_somebody_has_to_support_the_arm() -> None:
    advised = [advice for _what, advice in EXPLANATION.values() if re.search(r"release.* brakes", advice)]
    assert advised
    assert all("support the arm" in advice.partition("release")[0] for advice in advised)


def test_the_check_sees_a_command_that_does_not_exist() -> None:
    for words in (["reset"], ["ctl", "reset"], ["log", "recover"]):
        with pytest.raises(KeyError):
            resolve(APP, words)
