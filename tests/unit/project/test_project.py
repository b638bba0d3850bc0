"""The tree itself: pins, addresses, sizes, contracts and the commands of the README."""

from __future__ import annotations

import configparser
import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[3]
FOLDERS = ("benchmarks", "config", "docs", "examples", "qrobot", "tests", ".ci")
TEXT = {".py", ".md", ".toml", ".txt", ".ini", ".c", ".h", ""}
LONGEST_FILE = 450  # lines; the size from which a file takes in what has no home

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PIN = re.compile(r"(?P<name>[a-z0-9][a-z0-9-]*)==(?P<version>[0-9][0-9a-z.+]*)")
PINS = (ROOT / "constraints.txt").read_text().split()
MAKEFILE = (ROOT / "Makefile").read_text()


def text_files() -> list[Path]:
    """Every text file of the project, generated ones left out."""
    files = [path for path in ROOT.iterdir() if path.is_file()]
    files += [path for folder in FOLDERS for path in (ROOT / folder).rglob("*") if path.is_file()]
    generated = {"__pycache__", "_build", "api"}
    return [path for path in files if path.suffix in TEXT and not generated & set(path.relative_to(ROOT).parts)]


def requirements() -> list[Requirement]:
    lines = PROJECT["dependencies"] + [line for extra in PROJECT["optional-dependencies"].values() for line in extra]
    return [requirement for line in lines if (requirement := Requirement(line)).name != PROJECT["name"]]


def test_constraints_are_plain_pins_without_addresses() -> None:
    assert [line for line in PINS if not PIN.fullmatch(line)] == []


@pytest.mark.parametrize("requirement", requirements(), ids=str)
def test_each_dependency_is_pinned_to_a_version_it_allows(requirement: Requirement) -> None:
    pins = dict(line.split("==") for line in PINS)
    assert requirement.specifier.contains(pins[canonicalize_name(requirement.name)])


def test_each_core_dependency_stands_with_its_reason() -> None:
    block = re.search(r"^dependencies = \[\n(.*?)^\]", (ROOT / "pyproject.toml").read_text(), re.MULTILINE | re.DOTALL)
    assert block is not None
    assert [line for line in block[1].splitlines() if not re.search(r'",\s+# \w+', line)] == []


def test_no_file_names_a_home_a_temporary_folder_or_a_package_index() -> None:
    homes, indexes = "/(?:root|home|tmp|work)/[a-z]", "(?:index|extra-index|find)-(?:url|links)[ =]|file:" + "//"
    named = re.compile(rf"(?<![\w.}}~]){homes}|{indexes}")
    found = [f"{path.relative_to(ROOT)}: {match[0]}" for path in text_files() if (match := named.search(read(path)))]
    assert found == []


def read(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace")


def test_no_source_file_outgrows_its_noun() -> None:
    sizes = {str(path.relative_to(ROOT)): read(path).count("\n") for path in (ROOT / "qrobot").rglob("*.py")}
    assert {name: size for name, size in sizes.items() if size > LONGEST_FILE} == {}


def test_the_readme_names_commands_that_the_makefile_has() -> None:
    named = set(re.findall(r"\bmake ([a-z]+)\b", (ROOT / "README.md").read_text()))
    targets = set(re.findall(r"^([a-z]+):", MAKEFILE, re.MULTILINE))
    assert {"demo", "test"} <= named <= targets


def test_make_help_lists_every_target_meant_for_people() -> None:
    phony = re.search(r"^\.PHONY: (.*)$", MAKEFILE, re.MULTILINE)
    assert phony is not None
    helped = set(re.findall(r"^([a-z]+):.*## ", MAKEFILE, re.MULTILINE))
    parts = {"kernels", "rewritten", "unit", "virtual", "realtime", "shared", "alone"}
    assert helped == set(phony[1].split()) - parts


def test_continuous_integration_ends_in_the_test_command_of_the_readme() -> None:
    script = ROOT / ".ci/run"
    assert script.stat().st_mode & 0o111
    assert script.read_text().rstrip().endswith("exec make test")


def test_the_import_contracts_name_every_package_and_pure_module_that_there_is() -> None:
    contracts = configparser.ConfigParser()
    contracts.read(ROOT / ".importlinter")
    layers = contracts["importlinter:contract:layers"]["layers"]
    packages = {path.parent.name for path in (ROOT / "qrobot").glob("*/__init__.py")}
    assert packages <= set(re.findall(r"\w+", layers))
    pure = contracts["importlinter:contract:pure-modules"]["source_modules"].split()
    paths = [path.relative_to(ROOT).with_suffix("") for path in (ROOT / "qrobot").rglob("*.py")]
    assert set(pure) <= {".".join(path.parts).removesuffix(".__init__") for path in paths}


def test_the_licence_is_the_one_the_project_declares() -> None:
    text = (ROOT / "LICENSE").read_text()
    assert PROJECT["license"] == "Apache-2.0"
    assert "Apache License" in text
    assert "Version 2.0, January 2004" in text


def test_the_package_declares_its_types() -> None:
    assert (ROOT / "qrobot/py.typed").is_file()
