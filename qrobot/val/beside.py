"""Programs that run as process control programs: those that PCEXECUTE names, and what they call."""

from __future__ import annotations

from collections.abc import Iterator

from qrobot.val import tree
from qrobot.val.source import SourceFile


def beside_programs(source: SourceFile) -> set[str]:
    """Names of a file's programs that run beside the one that moves the arm, at least once."""
    actions = (line.action for program in source.programs.values() for line in program.lines)
    left = [action.program for action in actions if isinstance(action, tree.ProcessStart)]
    found: set[str] = set()
    while left:
        name = left.pop()
        if name in source.programs and name not in found:
            found.add(name)
            left += _called_by(source.programs[name])
    return found


def _called_by(program: tree.ValProgram) -> Iterator[str]:
    """Programs that a program calls, itself or at a signal."""
    for line in program.lines:
        if isinstance(line.action, tree.ProgramCall | tree.Reaction):
            yield line.action.program
