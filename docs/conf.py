"""Sphinx configuration: Markdown pages, and API pages read from the source without importing it."""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path
from typing import Any

from pygments.lexers.special import TextLexer

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "docs"))

from docstrings import to_restructured_text  # noqa: E402 (found through the line above)

_PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]

project = "QRobot"
author = _PROJECT["authors"][0]["name"]
copyright = author
release = version = _PROJECT["version"]

extensions = ["myst_parser", "autoapi.extension", "sphinx.ext.napoleon"]
exclude_patterns = ["_build"]
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 4
smartquotes_action = "qe"  # quotes and ellipses; -- stays what one types
html_theme = "furo"
html_title = f"QRobot {release}"
default_role = "literal"  # docstrings mark code with single backticks

autoapi_dirs = [str(ROOT / "qrobot")]
autoapi_root = "api"
autoapi_add_toctree_entry = False
autoapi_options = ["members", "show-module-summary"]
autoapi_keep_files = False
suppress_warnings = [
    # Names bound by unpacking (A, B = range(2)) and by compiled intrinsics: a static reader cannot follow them.
    "autoapi.python_import_resolution",
    # Two modules may have a class of one name, and an annotation says it without its module.
    "ref.python",
]


def setup(app: Any) -> None:
    """Turn docstrings into reStructuredText before napoleon reads their sections; show diagrams as their source."""
    app.add_lexer("mermaid", TextLexer)  # drawn where Markdown is shown; here a script from elsewhere would be needed
    app.connect("autodoc-process-docstring", _process_docstring, priority=100)


def _process_docstring(_app: Any, _what: str, _name: str, _thing: Any, _options: Any, lines: list[str]) -> None:
    lines[:] = to_restructured_text(lines)
