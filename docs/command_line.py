"""The reference page of the command, read from its own help."""

from __future__ import annotations

import re
import sys
from importlib import import_module
from typing import Any
from unittest.mock import patch

from cyclopts import App

from qrobot.cli.help_text import PLAIN_OPTIONS
from qrobot.cli.main import COMMANDS

INDENTED = re.compile(r"(?:^ {2}\S.*\n)+", re.MULTILINE)


def command_line() -> str:
    """Every subcommand with its parameters."""
    with patch.object(sys, "argv", ["qrobot"]):  # cyclopts writes the name of the running program into the usage
        page: str = _app().generate_docs(output_format="markdown", recursive=True, heading_level=1)
    page = page[page.index("## qrobot demo") :]
    return INDENTED.sub(lambda found: f"```sh\n{re.sub('^  ', '', found[0], flags=re.MULTILINE)}```\n", page)


def _app() -> App:
    """The command with every function loaded, so that each shows its whole docstring."""
    app = App(name="qrobot", help_format="plaintext", default_parameter=PLAIN_OPTIONS)
    for command in COMMANDS:
        app.command(_load(command.target), name=command.name)
    return app


def _load(target: str) -> Any:
    module_name, name = target.split(":")
    module = import_module(module_name)
    found = getattr(module, name)
    if isinstance(found, App):
        found.help = getattr(module, "HELP", None)  # the table's line may have replaced it
        found.default_parameter = PLAIN_OPTIONS  # its commands would have it from the whole command, but not on a page
    return found
