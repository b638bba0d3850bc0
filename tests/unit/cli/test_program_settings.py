"""What a program says of itself in its head."""

from __future__ import annotations

from pathlib import Path

import pytest

from qrobot.cli.program_settings import settings_of
from qrobot.errors import ConfigError

EXAMPLES = Path(__file__).parents[3] / "examples"
HEAD = '"""A program."""\n\n# /// script\n# dependencies = ["numpy"]\n#\n# [tool.qrobot]\n# {line}\n# ///\nprint()\n'


def program(folder: Path, text: str) -> Path:
    path = folder / "program.py"
    path.write_text(text)
    return path


def test_a_program_names_its_scene(tmp_path: Path) -> None:
    assert settings_of(program(tmp_path, HEAD.format(line='scene = "crank"'))).scene == "crank"


@pytest.mark.parametrize("text", ["", "print()\n", "# scene = 'crank'\n", HEAD.format(line="")])
def test_a_program_may_say_nothing(tmp_path: Path, text: str) -> None:
    assert settings_of(program(tmp_path, text)).scene is None


def test_a_compiled_program_says_nothing(tmp_path: Path) -> None:
    path = tmp_path / "program"
    path.write_bytes(b"\x7fELF" + bytes(range(128, 256)))
    assert settings_of(path).scene is None


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('scene = "moon"', ["program.py", "scene", "crank"]),
        ("scene = crank", ["program.py", "line"]),
        ('seen = "crank"', ["program.py", "seen"]),
        ("scene = 3", ["program.py", "scene"]),
        (f"scene = {'9' * 5000}", ["program.py"]),
    ],
)
def test_a_head_that_cannot_be_is_told(tmp_path: Path, line: str, words: list[str]) -> None:
    with pytest.raises(ConfigError) as caught:
        settings_of(program(tmp_path, HEAD.format(line=line)))
    assert all(word in str(caught.value) for word in words)


@pytest.mark.parametrize("table", ["tool = 3", "[tool]\n# qrobot = 5", "[[tool.qrobot]]"])
def test_a_head_whose_table_is_none_is_told(tmp_path: Path, table: str) -> None:
    text = HEAD.format(line="").replace("[tool.qrobot]", table)
    with pytest.raises(ConfigError, match=r"program.py, in its head: \[tool.qrobot\] is a table, not"):
        settings_of(program(tmp_path, text))


@pytest.mark.parametrize(
    ("name", "scene"), [("07_guarded_approach", "table"), ("08_crank", "crank"), ("09_peg_in_hole", "peg")]
)
def test_the_examples_that_touch_something_bring_it(name: str, scene: str) -> None:
    assert settings_of(EXAMPLES / f"{name}.py").scene == scene
