"""The syntax tree of VAL II: expressions, and the actions of a line.

Names are kept in lower case, for VAL is case-blind. Two trees are equal when they mean the same; columns do not count.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias


@dataclass(frozen=True)
class NumberLiteral:
    """A number without a sign."""

    value: float


@dataclass(frozen=True)
class TextLiteral:
    """Text between double quotes, for TYPE and PROMPT."""

    value: str


@dataclass(frozen=True)
class OutputFormat:
    """The form in which TYPE writes what follows: "I3", "F8.2"; "C2" is two line ends, "X3" three blanks."""

    code: str


@dataclass(frozen=True)
class VariableName:
    """A number or a location by its name; `#` begins the name of a precision point.

    Attributes:
        indices: of an element of an array; empty for none.
        column: where it stands, from 1.
    """

    name: str
    indices: tuple[Expression, ...] = ()
    column: int = field(default=0, compare=False, repr=False)


@dataclass(frozen=True)
class GroupedVariable:
    """`(x)`: the value of a variable, which a program that is called cannot change."""

    variable: VariableName
    column: int = field(default=0, compare=False, repr=False)


@dataclass(frozen=True)
class FunctionCall:
    """`SIN(x)`, `TRANS(,,10)`; None stands for an argument that was left out."""

    name: str
    arguments: tuple[Expression | None, ...]
    column: int = field(default=0, compare=False, repr=False)


@dataclass(frozen=True)
class LocationChange:
    """`SHIFT(a BY dx, dy, dz)` or `SCALE(a BY k)`."""

    name: str
    location: Expression
    by: tuple[Expression | None, ...]
    column: int = field(default=0, compare=False, repr=False)


@dataclass(frozen=True)
class UnaryOperation:
    """`-x`, `+x` or `NOT x`."""

    operator: str
    operand: Expression


@dataclass(frozen=True)
class BinaryOperation:
    """`x + y`, `a:b` and so on.

    Attributes:
        column: where the operator stands, from 1.
    """

    operator: str
    left: Expression
    right: Expression
    column: int = field(default=0, compare=False, repr=False)


Expression: TypeAlias = (
    NumberLiteral
    | VariableName
    | GroupedVariable
    | FunctionCall
    | LocationChange
    | UnaryOperation
    | BinaryOperation
    | TextLiteral
)


@dataclass(frozen=True)
class Instruction:
    """An instruction whose arguments are expressions: `APPRO part, 50`; None for one that was left out.

    Attributes:
        word: in capitals.
        always: the word ALWAYS stands behind.
    """

    word: str
    arguments: tuple[Expression | None, ...] = ()
    always: bool = False


@dataclass(frozen=True)
class SpeedSetting:
    """`SPEED n [MMPS] [ALWAYS]`."""

    value: Expression
    in_mm_s: bool = False
    always: bool = False


@dataclass(frozen=True)
class Assignment:
    """`x = e`; with `location`, `SET a = b`."""

    target: VariableName
    value: Expression
    location: bool = False


@dataclass(frozen=True)
class NumberedAssignment:
    """`TIMER n = e`, or `DAC n = e`."""

    word: str
    number: Expression
    value: Expression


@dataclass(frozen=True)
class ParameterSetting:
    """`PARAMETER HAND.TIME = e`."""

    name: str
    value: Expression


@dataclass(frozen=True)
class SwitchSetting:
    """`ENABLE CP`, `DISABLE DRY.RUN, TRACE`."""

    on: bool
    switches: tuple[str, ...]


@dataclass(frozen=True)
class Decomposition:
    """`DECOMPOSE x[] = a`: the six numbers of a location into an array."""

    target: str
    location: Expression


@dataclass(frozen=True)
class Goto:
    """`GOTO 10`, or `IF e GOTO 10`."""

    label: int
    condition: Expression | None = None
    column: int = field(default=0, compare=False, repr=False)


@dataclass(frozen=True)
class Block:
    """A line that begins, divides or ends a structure.

    Attributes:
        word: "IF", "ELSE", "WHILE", "DO", "UNTIL", "CASE", "ANY" or "END".
        condition: of IF, WHILE and UNTIL; what CASE compares.
    """

    word: str
    condition: Expression | None = None


@dataclass(frozen=True)
class ForLoop:
    """`FOR i = a TO b STEP c`."""

    variable: VariableName
    first: Expression
    last: Expression
    step: Expression | None = None


@dataclass(frozen=True)
class CaseValues:
    """`VALUE 1, -2:` in a CASE."""

    values: tuple[float, ...]


@dataclass(frozen=True)
class ProgramCall:
    """`CALL p(a, b)`; None stands for an argument that was left out."""

    program: str
    arguments: tuple[Expression | None, ...] = ()
    column: int = field(default=0, compare=False, repr=False)


@dataclass(frozen=True)
class Reaction:
    """`REACT n, p, priority`, REACTI alike; `REACTE p` has no signal."""

    word: str
    signal: Expression | None
    program: str
    priority: Expression | None = None
    column: int = field(default=0, compare=False, repr=False)


@dataclass(frozen=True)
class ProcessStart:
    """`PCEXECUTE p, cycles`: a program that runs beside and moves nothing."""

    program: str
    cycles: Expression | None = None
    column: int = field(default=0, compare=False, repr=False)


@dataclass(frozen=True)
class TypeOut:
    """`TYPE "x = ", /F8.2, x`."""

    items: tuple[Expression | OutputFormat, ...] = ()


@dataclass(frozen=True)
class PromptFor:
    """`PROMPT "how many? ", n`."""

    text: str
    target: VariableName


StepAction: TypeAlias = (
    Instruction
    | SpeedSetting
    | Assignment
    | NumberedAssignment
    | ParameterSetting
    | SwitchSetting
    | Decomposition
    | Goto
    | Block
    | ForLoop
    | CaseValues
    | ProgramCall
    | Reaction
    | ProcessStart
    | TypeOut
    | PromptFor
)


@dataclass(frozen=True)
class ProgramLine:
    """One line, which is one step, also when it is empty.

    Attributes:
        label: number in front, to GOTO; None for none.
        action: what it does; None for nothing.
        comment: text behind the semicolon; None when there is none.
        line: its number in the file, from 1.
        column: where its first word stands, from 1; 0 for a line without one.
    """

    action: StepAction | None = None
    label: int | None = None
    comment: str | None = None
    line: int = field(default=0, compare=False, repr=False)
    column: int = field(default=0, compare=False, repr=False)


@dataclass(frozen=True)
class ValProgram:
    """A program.

    Attributes:
        name: in lower case.
        parameters: names of its arguments.
        lines: its steps; step n is `lines[n - 1]`.
        line: where `.PROGRAM` stands in the file.
    """

    name: str
    parameters: tuple[str, ...] = ()
    lines: tuple[ProgramLine, ...] = ()
    line: int = field(default=0, compare=False, repr=False)
