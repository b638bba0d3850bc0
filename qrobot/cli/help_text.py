"""Looks of the help: paragraphs as wide as the terminal, one name for a flag, no default that says nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from cyclopts import Parameter

if TYPE_CHECKING:
    from cyclopts.help import HelpPanel
    from rich.console import Console, ConsoleOptions


def default_told(value: Any) -> str | None:
    """Write an option's default as help tells it: None for a flag that is off, what is not given, what is empty."""
    if isinstance(value, tuple):
        return " ".join(map(str, value)) or None
    return None if value is False or value is None else str(value) or None


PLAIN_OPTIONS: Final = Parameter(negative_bool=(), negative_iterable=(), show_default=default_told)
"""No `--no-json` and no `--empty-then`, which ask for what is so anyway."""


def flowing(text: str) -> str:
    """`text` with the lines of each paragraph joined; those that are indented keep their own."""
    lines: list[str] = []
    for line in text.split("\n"):
        if lines and line and lines[-1] and not line.startswith(" ") and not lines[-1].startswith(" "):
            lines[-1] += f" {line}"
        else:
            lines.append(line)
    return "\n".join(lines)


class FlowingHelp:
    """Cyclopts' own help, with the line breaks of docstrings taken out of sentences."""

    def __call__(self, console: Console, options: ConsoleOptions, panel: HelpPanel) -> None:
        """Print a list of options or commands."""
        from cyclopts.help import DefaultFormatter

        for entry in panel.entries:
            _let_flow(entry.description)
        DefaultFormatter()(console, options, panel)

    def render_description(self, console: Console, _options: ConsoleOptions, description: Any) -> None:
        """Print what a command is for."""
        _let_flow(description)
        console.print(description)

    def render_usage(self, console: Console, options: ConsoleOptions, usage: Any) -> None:
        """Print the line with the words of a command."""
        from cyclopts.help import DefaultFormatter

        DefaultFormatter().render_usage(console, options, usage)


def _let_flow(description: Any) -> None:
    text = getattr(description, "primary_renderable", None)
    if text is not None:
        text.plain = flowing(text.plain)
