"""Files, folders and modules that pages, docstrings and comments name are there."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[3]
FOLDERS = ("qrobot", "tests", "docs", "config", "examples", "benchmarks")
MADE = ("docs/_build", "docs/api", "qrobot/_config", "qrobot/_examples")  # when something is built
MODULES_OF_OTHERS = {"venv", "pytest", "pip"}

ROOTED = re.compile(rf"(?<![\w./-])(?:{'|'.join(FOLDERS)})/[\w./-]*\w")
MODULE = re.compile(r"(?<![\w./-])qrobot(?:\.[a-z_0-9]+)+")
FILE = re.compile(r"(?<![\w./{}-])(?:[\w-]+/)*[\w-]+\.py\b")
STARTED = re.compile(r"python3? -m ([\w.]+)")
EXAMPLE = re.compile(r"path/to/|\bmy_")  # the reader's own


def files(*patterns: str) -> list[Path]:
    found = [path for folder in (*FOLDERS, ".ci") for pattern in patterns for path in (ROOT / folder).rglob(pattern)]
    found += [path for pattern in patterns for path in ROOT.glob(pattern)]
    return sorted(path for path in found if path.is_file() and not {"_build", "api"} & set(path.parts))


PAGES = files("*.md")
SOURCES = files("*.py", "*.toml", "*.c", "*.h", "Makefile", ".importlinter")
PACKAGE = [path for path in SOURCES if path.is_relative_to(ROOT / "qrobot")]


def page_name(path: Path) -> str:
    return str(path.relative_to(ROOT))


def missing_paths(text: str) -> list[str]:
    """Paths from the root of this project that lead to no file, folder or module."""
    named = {name for name in ROOTED.findall(text) if not name.startswith(MADE)}
    return sorted(name for name in named if not (ROOT / name).exists() and not (ROOT / f"{name}.py").exists())


def missing_modules(text: str) -> list[str]:
    return sorted({name for name in MODULE.findall(text) if not exists(name)})


@cache
def exists(name: str) -> bool:
    """Whether `a.b.c` is a module, or a name in one."""
    parts = name.split(".")
    for k in range(len(parts), 0, -1):
        folder = ROOT.joinpath(*parts[:k])
        for source in (folder.with_suffix(".py"), folder / "__init__.py"):
            if source.is_file():
                return not parts[k:] or re.search(rf"\b{parts[k]}\b", source.read_text()) is not None
    return ROOT.joinpath(*parts).is_dir()


@cache
def file_names() -> set[str]:
    """The end of the path of every source file, from one name to all of it."""
    return {"/".join(path.relative_to(ROOT).parts[-k:]) for path in files("*.py") for k in range(1, 9)}


def missing_files(text: str) -> list[str]:
    """Names of Python files, with or without folders, that no file has."""
    return sorted({name for name in FILE.findall(text) if name not in file_names() and not EXAMPLE.search(name)})


def missing_programs(text: str) -> Iterator[str]:
    """Modules to be started by `python -m` that cannot be."""
    for name in STARTED.findall(text):
        place = ROOT / name.replace(".", "/")
        there = place.with_suffix(".py").exists() or (place / "__main__.py").exists()
        if not there and name.partition(".")[0] not in MODULES_OF_OTHERS:
            yield name


def test_what_a_page_names_is_there() -> None:
    texts = {page_name(page): page.read_text() for page in PAGES}
    found = {
        name: [*missing_paths(text), *missing_modules(text), *missing_programs(text)] for name, text in texts.items()
    }
    assert {name: missing for name, missing in found.items() if missing} == {}


def test_what_sources_name_is_there() -> None:
    invented = {"test_named_places.py", "test_virtual_time_only.py", "test_features_page.py", "test_source_digest.py"}
    found = {}
    for path in (path for path in SOURCES if path.name not in invented):
        text = path.read_text(errors="replace")
        missing = [name for name in missing_paths(text) if not name.endswith("test_")] + missing_modules(text)
        found[page_name(path)] = [*missing, *missing_programs(text)]
    assert {name: missing for name, missing in found.items() if missing} == {}


def test_files_that_the_package_names_are_there() -> None:
    found = {page_name(path): missing_files(path.read_text(errors="replace")) for path in PACKAGE}
    assert {name: missing for name, missing in found.items() if missing} == {}


def test_the_checks_tell_what_is_not_there() -> None:
    assert missing_paths("see `tests/hardware` and qrobot/servo/cycle.py, docs/_build") == ["tests/hardware"]
    assert missing_modules("`qrobot.guard`, qrobot.servo.cycle, qrobot.errors.QRobotError") == ["qrobot.guard"]
    assert missing_files("memories.py, board_memory.py, hwif/bus.py, my_laws.py") == ["memories.py"]
    assert list(missing_programs("python -m benchmarks, python -m tests.nothing")) == ["tests.nothing"]
