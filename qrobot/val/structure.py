"""Structures of a program made into jumps: a program counter, so that GOTO may lead into them and out of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from qrobot.errors import ProgramError
from qrobot.val.tree import Block, CaseValues, ForLoop, Goto, ProgramLine, StepAction, ValProgram

_LIKELY: Final = {"DO": "UNTIL"}  # what closes a structure, END otherwise


@dataclass
class Structure:
    """One that is open while the lines are gone through.

    Attributes:
        word: that began it.
        at: the step that did, from 0.
        parts: steps of its ELSE, VALUE, ANY.
    """

    word: str
    at: int
    parts: list[int] = field(default_factory=list)


@dataclass(frozen=True)
class Jumps:
    """The places that steps lead to, all from 0; a step behind the last is the end of the program.

    Attributes:
        labels: step of each label.
        to: for IF the step to go on with when it is false; for ELSE, VALUE and ANY that behind the END; for the END of
            a loop its head, for WHILE and FOR the step behind the END; for UNTIL its DO.
        cases: steps of VALUE and ANY, for each CASE.
    """

    labels: dict[int, int]
    to: dict[int, int]
    cases: dict[int, tuple[int, ...]]


def jumps_of(program: ValProgram) -> tuple[Jumps, list[ProgramError]]:
    """Jumps of a program, and its mistakes: structures that do not match, labels that are missing or stand twice."""
    finder = _Finder()
    for at, line in enumerate(program.lines):
        finder.look(at, line)
    finder.finish(program)
    return Jumps(finder.labels, finder.to, finder.cases), finder.errors


class _Finder:
    """Goes through the lines with a stack of open structures."""

    def __init__(self) -> None:
        self.labels: dict[int, int] = {}
        self.to: dict[int, int] = {}
        self.cases: dict[int, tuple[int, ...]] = {}
        self.errors: list[ProgramError] = []
        self._open: list[Structure] = []

    def look(self, at: int, line: ProgramLine) -> None:
        """Take the next step."""
        if line.label is not None:
            if line.label in self.labels:
                self.errors.append(ProgramError(f"label {line.label} stands a second time", line.line, 1))
            self.labels.setdefault(line.label, at)
        try:
            self._match(at, line.action)
        except ProgramError as error:
            self.errors.append(ProgramError(error.what, line.line, line.column))

    def finish(self, program: ValProgram) -> None:
        """Tell what is still open, and labels that are nowhere."""
        for structure in self._open:
            wanted, begun = _LIKELY.get(structure.word, "END"), program.lines[structure.at]
            what = f"expected {wanted} for this {structure.word}; .END comes first"
            self.errors.append(ProgramError(what, begun.line, begun.column))
        for line_ in program.lines:
            action = line_.action
            if isinstance(action, Goto) and action.label not in self.labels:
                self.errors.append(ProgramError(f"there is no label {action.label}", line_.line, action.column))

    def _match(self, at: int, action: StepAction | None) -> None:
        match action:
            case Block(word="IF" | "WHILE" | "DO" | "CASE" as word):
                self._open.append(Structure(word, at))
            case ForLoop():
                self._open.append(Structure("FOR", at))
            case Block(word="ELSE"):
                self._part(at, "ELSE", "IF")
            case CaseValues():
                self._part(at, "VALUE", "CASE")
            case Block(word="ANY"):
                self._part(at, "ANY", "CASE")
            case Block(word="UNTIL"):
                self.to[at] = self._close("UNTIL", "DO").at
            case Block(word="END"):
                self._end(at)

    def _part(self, at: int, word: str, of: str) -> None:
        if not self._open or self._open[-1].word != of:
            raise ProgramError(f"{word} without {of}")
        if word == "ELSE" and self._open[-1].parts:
            raise ProgramError("a second ELSE of one IF")
        self._open[-1].parts.append(at)

    def _close(self, word: str, *of: str) -> Structure:
        if not self._open or self._open[-1].word not in of:
            inside = f"; {self._open[-1].word} is open" if self._open else ""
            raise ProgramError(f"{word} without {' or '.join(of)}{inside}")
        return self._open.pop()

    def _end(self, at: int) -> None:
        structure = self._close("END", "IF", "WHILE", "FOR", "CASE")
        if structure.word in ("WHILE", "FOR"):
            self.to |= {structure.at: at + 1, at: structure.at}
            return
        self.to |= dict.fromkeys(structure.parts, at + 1)
        if structure.word == "CASE":
            self.cases[structure.at] = tuple(structure.parts)
            self.to[structure.at] = at + 1
        else:
            self.to[structure.at] = structure.parts[0] + 1 if structure.parts else at + 1
