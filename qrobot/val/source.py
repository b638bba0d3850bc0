"""Files of VAL II (`.v2`): programs between `.PROGRAM` and `.END`, and stored locations and numbers.

    .PROGRAM pick(n)
        MOVE part:grip
    .END
    .LOCATIONS
    part 500 100 -200 90 90 0
    #home 0 -90 90 0 0 0
    .END
    .REALS
    pitch 60
    .END

A transformation is x, y, z in mm and o, a, t in degrees, a precision point the joints in degrees. The headings
`.LOCATIONS` and `.REALS` are those of V+, recalled.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from math import isfinite, nan
from pathlib import Path
from typing import Final, TypeAlias

from qrobot.errors import ConfigError, ProgramError
from qrobot.printable import printable
from qrobot.val.evaluate import LARGEST_INDEX
from qrobot.val.parser import parse_line, parse_variable
from qrobot.val.printer import print_expression, print_number, print_program
from qrobot.val.tree import NumberLiteral, ProgramLine, ValProgram, VariableName
from qrobot.val.values import within_reason
from qrobot.val.vocabulary import taken
from qrobot.whole_file import replace_file

MOST_LINES: Final = 100_000  # of a file [A]
NUMBERS_OF_POSE: Final = 6  # a precision point has one for each joint, which the file does not tell
_HEAD: Final = re.compile(
    r"\s*\.PROGRAM\s+(?P<name>[a-z][a-z0-9_.]*)\s*(\(\s*(?P<parameters>[^()]*?)\s*\))?\s*(;.*)?$", re.IGNORECASE
)
_PARAMETER: Final = re.compile(r"#?[a-z][a-z0-9_.]*$", re.IGNORECASE)

Numbered: TypeAlias = tuple[int, str]


@dataclass
class SourceFile:
    """The contents of a file.

    Attributes:
        programs: by name.
        locations: six numbers each, those of a precision point one for each joint, by the name as it is printed: `a`,
            `#p`, `a[1]`.
        numbers: by name.
    """

    programs: dict[str, ValProgram] = field(default_factory=dict)
    locations: dict[str, tuple[float, ...]] = field(default_factory=dict)
    numbers: dict[str, float] = field(default_factory=dict)


def load_source(path: Path) -> SourceFile:
    """Read a file. Raises ConfigError: it cannot be read; ProgramError: the first mistake in it, with its name."""
    source, errors = read_source(_text(path))
    if errors:
        raise ProgramError(errors[0].what, errors[0].line, errors[0].column, printable(str(path)))
    return source


def store_source(path: Path, source: SourceFile) -> None:
    """Write a file. Raises ConfigError when it cannot be written."""
    try:
        replace_file(path, print_source(source))
    except (OSError, ValueError) as error:  # the latter of a name that none can have
        raise ConfigError(f"cannot write {printable(str(path))}: {_reason(error)}") from error


def source_text(path: Path) -> str:
    """Text of a file. Raises ConfigError when it cannot be read, or is empty."""
    if not (text := _text(path)).strip():
        raise ConfigError(f"{path} is empty; a file begins with .PROGRAM")
    return text


def _text(path: Path) -> str:
    try:
        if path.exists() and not path.is_file():  # a device may have no end
            raise ConfigError(f"cannot read {printable(str(path))}: it is no file")
        return path.read_text(encoding="utf-8-sig")  # editors put a mark of the byte order in front
    except (OSError, ValueError) as error:
        raise ConfigError(f"cannot read {printable(str(path))}: {_reason(error)}") from error


def _reason(error: OSError | ValueError) -> str:
    if isinstance(error, UnicodeDecodeError):
        return "it is no text, but a binary file or one in another coding than UTF-8"
    return str(error.strerror if isinstance(error, OSError) else error)


def print_source(source: SourceFile) -> str:
    """The text of a file; reading it gives the same."""
    parts = [print_program(program) for program in source.programs.values()]
    locations = [f"{name} {' '.join(map(print_number, numbers))}" for name, numbers in source.locations.items()]
    numbers = [f"{name} {print_number(number)}" for name, number in source.numbers.items()]
    for heading, lines in ((".LOCATIONS", locations), (".REALS", numbers)):
        parts += ["\n".join([heading, *lines, ".END", ""])] if lines else []
    return "\n".join(parts)


def read_source(text: str) -> tuple[SourceFile, list[ProgramError]]:
    """Contents of a file's text, and every mistake in it; lines with a mistake are empty."""
    lines = text.splitlines()
    if len(lines) > MOST_LINES:
        return SourceFile(), [ProgramError(f"a file has at most {MOST_LINES} lines, this has {len(lines)}")]
    reader = _SourceReader()
    rest = iter(enumerate(lines, start=1))
    for number, line in rest:
        reader.try_to(reader.section, number, line, rest)
    return reader.source, reader.errors


class _SourceReader:
    """Reads sections, and gathers mistakes."""

    def __init__(self) -> None:
        self.source = SourceFile()
        self.errors: list[ProgramError] = []

    def try_to(self, read: object, number: int, *rest: object) -> None:
        """Call `read`; keep the ProgramError that it raises."""
        try:
            read(number, *rest)  # type: ignore[operator]
        except ProgramError as error:
            self.errors.append(ProgramError(error.what, error.line or number, error.column))

    def section(self, number: int, line: str, rest: Iterator[Numbered]) -> None:
        """Read the section that begins with this line; empty lines and comments stand between them."""
        word = line.partition(";")[0].strip().upper()
        if word.startswith(".PROGRAM"):
            self._program(number, line, rest)
        elif word in (".LOCATIONS", ".REALS"):
            store = self._location if word == ".LOCATIONS" else self._number
            for at, entry in _until_end(number, rest, self.errors):
                self.try_to(store, at, entry)
        elif word:
            raise ProgramError(
                f"expected .PROGRAM, .LOCATIONS or .REALS; {printable(line.strip()[:40])!r} stands there", number, 1
            )

    def _program(self, number: int, line: str, rest: Iterator[Numbered]) -> None:
        head = _HEAD.match(line)
        steps: list[ProgramLine] = []
        for at, text in _until_end(number, rest, self.errors):
            steps.append(self._step(at, text))
        if head is None:
            raise ProgramError("expected `.PROGRAM name` or `.PROGRAM name(a, b)`", number, 1)
        name = head["name"].lower()
        parameters = _parameters(head["parameters"] or "", number)
        if name in self.source.programs:
            raise ProgramError(f"there are two programs {name}", number, 1)
        self.source.programs[name] = ValProgram(name, parameters, tuple(steps), number)

    def _step(self, number: int, text: str) -> ProgramLine:
        """The step of a line; an empty one where it has a mistake."""
        try:
            return parse_line(text, number)
        except ProgramError as error:
            self.errors.append(error)
            return ProgramLine(line=number)

    def _location(self, _number: int, entry: str) -> None:
        if (found := _entry(entry)) is not None:
            name, numbers = found
            if not numbers or (len(numbers) != NUMBERS_OF_POSE and not name.startswith("#")):
                raise ProgramError(f"location {name}: expected 6 numbers, not {len(numbers)}", column=1)
            within_reason(numbers)
            _once(name, self.source.locations)
            self.source.locations[name] = numbers

    def _number(self, _number: int, entry: str) -> None:
        if (found := _entry(entry)) is not None:
            name, numbers = found
            if len(numbers) != 1:
                raise ProgramError(f"{name}: expected 1 number, not {len(numbers)}", column=1)
            _once(name, self.source.numbers)
            self.source.numbers[name] = numbers[0]


def _once(name: str, stored: Mapping[str, object]) -> None:
    if name in stored:
        raise ProgramError(f"{name} is there twice", column=1)


def _until_end(number: int, rest: Iterator[Numbered], errors: list[ProgramError]) -> Iterator[Numbered]:
    """The lines up to `.END`; an error when there is none."""
    for at, line in rest:
        if line.partition(";")[0].strip().upper() == ".END":
            return
        yield at, line
    errors.append(ProgramError("expected .END; the file ends before it", number, 1))


def _parameters(text: str, number: int) -> tuple[str, ...]:
    names = [name.strip() for name in text.split(",")] if text else []
    wrong = next((name for name in names if not _PARAMETER.match(name)), None)
    if wrong is not None or len({name.lower() for name in names}) != len(names):
        raise ProgramError("expected names with commas as parameters, each once", number, 1)
    if refusal := next(filter(None, (taken(name.lower()) for name in names)), ""):
        raise ProgramError(refusal, number, 1)
    return tuple(name.lower() for name in names)


def _entry(line: str) -> tuple[str, tuple[float, ...]] | None:
    """Name and numbers of a stored value; None for an empty line. Raises ProgramError: such a value has none."""
    words = line.partition(";")[0].split()
    if not words:
        return None
    try:
        numbers = tuple(float(word) for word in words[1:])
    except ValueError:
        raise ProgramError("expected a name and numbers with blanks between them", column=1) from None
    if not all(map(isfinite, numbers)):
        raise ProgramError("expected finite numbers", column=1)
    variable = parse_variable(words[0])
    if refusal := taken(variable.name):
        raise ProgramError(refusal, column=1)
    return stored_name(variable), numbers


def stored_name(variable: VariableName) -> str:
    """The name under which a variable is stored. Raises as `constant_indices`."""
    constant_indices(variable)
    return print_expression(variable)


def constant_indices(variable: VariableName) -> tuple[int, ...]:
    """The indices of a variable outside programs. Raises ProgramError: one is no number that an element has."""
    numbers = [index.value if isinstance(index, NumberLiteral) else nan for index in variable.indices]
    if not all(0 <= number <= LARGEST_INDEX and number == int(number) for number in numbers):
        raise ProgramError(f"expected whole numbers from 0 to {LARGEST_INDEX} as indices", column=1)
    return tuple(map(int, numbers))
