"""Sphinx configuration: Markdown pages, and API pages read from the source without importing it."""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path
from typing import Any

from autoapi.settings import TEMPLATE_DIR
from jinja2 import ChoiceLoader, FileSystemLoader, PrefixLoader
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
exclude_patterns = ["_build", "_templates"]
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 4
highlight_language = "text"  # what names no language is output, or a formula
smartquotes_action = "qe"  # quotes and ellipses; -- stays what one types
html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
html_title = f"QRobot {release}"
default_role = "literal"  # docstrings mark code with single backticks

autoapi_template_dir = "_templates"
autoapi_dirs = [str(ROOT / "qrobot")]
autoapi_root = "api"
API = "api/qrobot/index"
autoapi_add_toctree_entry = False
autoapi_options = ["members", "show-module-summary"]
autoapi_keep_files = False
suppress_warnings = [
    # Names bound by unpacking (A, B = range(2)) and by compiled intrinsics: a static reader cannot follow them.
    "autoapi.python_import_resolution",
    # Two modules may have a class of one name, and an annotation says it without its module.
    "ref.python",
]


def autoapi_prepare_jinja_env(environment: Any) -> None:
    """Let our templates extend those of autoapi, and show what a module says first of itself."""
    own = environment.loader
    environment.loader = ChoiceLoader([own, PrefixLoader({"packaged": FileSystemLoader(TEMPLATE_DIR)})])
    environment.filters["first_paragraph"] = _first_paragraph


def _first_paragraph(docstring: str) -> str:
    return " ".join(to_restructured_text([" ".join(docstring.strip().split("\n\n")[0].split())])).strip()


def setup(app: Any) -> None:
    """Turn docstrings into reStructuredText before napoleon reads their sections; show diagrams as their source."""
    app.add_lexer("mermaid", TextLexer)  # drawn where Markdown is shown; here a script from elsewhere would be needed
    app.connect("autodoc-process-docstring", _process_docstring, priority=100)
    app.connect("source-read", _keep_out_of_tree)
    app.connect("html-page-context", _lead_up, priority=900)  # after the theme's own


def _keep_out_of_tree(_app: Any, page: str, source: list[str]) -> None:
    """Pages of modules are a tree of their own: in that of the others they would be 800 lines on every page."""
    if page == API:
        source[0] = f":orphan:\n\n{source[0]}"


def _lead_up(_app: Any, page: str, _template: str, context: dict[str, Any], _doctree: Any) -> None:
    """Above the tree of pages, show the packages that a module's page is in."""
    if not page.startswith("api/"):
        return
    _, *packages, _ = page.split("/")
    pages = ["/".join(["api", *packages[: k + 1], "index"]) for k in range(len(packages))]
    links = [f'<a href="{context["pathto"](above)}">{name}</a>' for above, name in zip(pages, packages, strict=True)]
    context["furo_navigation_tree"] = f'<p class="module-path">{".".join(links)}</p>{context["furo_navigation_tree"]}'


def _process_docstring(_app: Any, _what: str, _name: str, _thing: Any, _options: Any, lines: list[str]) -> None:
    lines[:] = to_restructured_text(lines)
