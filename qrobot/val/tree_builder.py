"""Parse trees of lark made into the trees of `tree`."""

from __future__ import annotations

from math import isfinite
from typing import Any, TypeAlias

from lark import Token, Transformer

from qrobot.errors import ProgramError
from qrobot.val import tree
from qrobot.val.vocabulary import LOCATION_CHANGES, PLAIN_FUNCTIONS, taken

RuleParts: TypeAlias = list[Any]


def _column(token: Token) -> int:
    return token.column or 0


def _words(parts: RuleParts) -> set[str]:
    """Keywords among the parts, in capitals."""
    return {str(part).upper() for part in parts if isinstance(part, Token)}


def _expressions(parts: RuleParts) -> RuleParts:
    return [part for part in parts if not isinstance(part, Token)]


class TreeBuilder(Transformer[Token, Any]):
    """One method for each rule of the grammar, called with the parts of it."""

    def step(self, parts: RuleParts) -> tuple[int | None, tree.StepAction | None]:
        """Make the tree of the rule `step`."""
        label = int(parts[0]) if parts and isinstance(parts[0], Token) else None
        return label, next(iter(_expressions(parts)), None)

    def only_expression(self, parts: RuleParts) -> tree.Expression:
        """Make the tree of the rule `only_expression`."""
        return parts[0]  # type: ignore[no-any-return]

    # ---------------------------------------------------------------------------------------------- expressions

    def number(self, parts: RuleParts) -> tree.NumberLiteral:
        """Make the tree of the rule `number`."""
        return tree.NumberLiteral(_finite(parts[0]))

    def text(self, parts: RuleParts) -> tree.TextLiteral:
        """Make the tree of the rule `text`."""
        return tree.TextLiteral(parts[0][1:-1])

    def output_format(self, parts: RuleParts) -> tree.OutputFormat:
        """Make the tree of the rule `output_format`."""
        return tree.OutputFormat(str(parts[0])[1:].upper())

    def indices(self, parts: RuleParts) -> tuple[tree.Expression, ...]:
        """Make the tree of the rule `indices`."""
        return tuple(parts)

    def variable(self, parts: RuleParts) -> tree.VariableName:
        """Make the tree of the rule `variable`."""
        if isinstance(parts[0], tree.VariableName):
            return parts[0]
        return tree.VariableName(str(parts[0]).lower(), parts[1] if len(parts) > 1 else (), _column(parts[0]))

    def value(self, parts: RuleParts) -> tree.VariableName | tree.FunctionCall:
        """Make the tree of the rule `value`."""
        name = self.variable(parts)
        plain = not name.indices and name.name in PLAIN_FUNCTIONS
        return tree.FunctionCall(name.name.upper(), (), name.column) if plain else name

    def grouped(self, parts: RuleParts) -> tree.Expression:
        """Make the tree of the rule `grouped`; the tree itself tells what else than a variable binds closest."""
        inner: tree.Expression = parts[0]
        if isinstance(inner, tree.VariableName) and not taken(inner.name):
            return tree.GroupedVariable(inner, inner.column)
        return inner

    def argument(self, parts: RuleParts) -> tree.Expression | None:
        """Make the tree of the rule `argument`."""
        return parts[0] if parts else None

    def arguments(self, parts: RuleParts) -> tuple[tree.Expression | None, ...]:
        """Make the tree of the rule `arguments`."""
        return () if parts == [None] else tuple(parts)

    def function(self, parts: RuleParts) -> tree.FunctionCall:
        """Make the tree of the rule `function`."""
        return tree.FunctionCall(str(parts[0]).upper(), parts[1], _column(parts[0]))

    def change(self, parts: RuleParts) -> tree.LocationChange:
        """Make the tree of the rule `change`."""
        name, location, _, by = parts
        if name.upper() not in LOCATION_CHANGES:
            raise ProgramError(f"BY belongs to {' and '.join(LOCATION_CHANGES)}, not to {name}", column=_column(name))
        return tree.LocationChange(name.upper(), location, by, _column(name))

    def unary(self, parts: RuleParts) -> tree.UnaryOperation:
        """Make the tree of the rule `unary`."""
        return tree.UnaryOperation(parts[0].upper(), parts[1])

    def binary(self, parts: RuleParts) -> tree.BinaryOperation:
        """Make the tree of the rule `binary`."""
        left, operator, right = parts
        return tree.BinaryOperation(operator.upper(), left, right, _column(operator))

    # --------------------------------------------------------------------------------------------------- actions

    def instruction(self, parts: RuleParts) -> tree.Instruction:
        """Make the tree of the rule `instruction`."""
        return tree.Instruction(parts[0].upper(), parts[1])

    def manner(self, parts: RuleParts) -> tree.Instruction:
        """Make the tree of the rule `manner`."""
        return tree.Instruction(parts[0].upper(), tuple(_expressions(parts)), "ALWAYS" in _words(parts))

    def assignment(self, parts: RuleParts) -> tree.Assignment:
        """Make the tree of the rule `assignment`."""
        return tree.Assignment(*parts)

    def setting(self, parts: RuleParts) -> tree.Assignment:
        """Make the tree of the rule `setting`."""
        return tree.Assignment(parts[1], parts[2], location=True)

    def speed(self, parts: RuleParts) -> tree.SpeedSetting:
        """Make the tree of the rule `speed`."""
        words = _words(parts)
        return tree.SpeedSetting(parts[1], "MMPS" in words, "ALWAYS" in words)

    def numbered(self, parts: RuleParts) -> tree.NumberedAssignment:
        """Make the tree of the rule `numbered`."""
        return tree.NumberedAssignment(parts[0].upper(), parts[1], parts[2])

    def parameter(self, parts: RuleParts) -> tree.ParameterSetting:
        """Make the tree of the rule `parameter`."""
        return tree.ParameterSetting(parts[1].upper(), parts[2])

    def switch(self, parts: RuleParts) -> tree.SwitchSetting:
        """Make the tree of the rule `switch`."""
        return tree.SwitchSetting(parts[0].upper() == "ENABLE", tuple(name.upper() for name in parts[1:]))

    def decompose(self, parts: RuleParts) -> tree.Decomposition:
        """Make the tree of the rule `decompose`."""
        return tree.Decomposition(parts[1].lower(), parts[2])

    def goto(self, parts: RuleParts) -> tree.Goto:
        """Make the tree of the rule `goto`."""
        return tree.Goto(int(parts[1]), column=_column(parts[1]))

    def if_goto(self, parts: RuleParts) -> tree.Goto:
        """Make the tree of the rule `if_goto`."""
        return tree.Goto(int(parts[3]), parts[1], _column(parts[3]))

    def block(self, parts: RuleParts) -> tree.Block:
        """Make the tree of the rule `block`."""
        return tree.Block(parts[0].upper(), next(iter(_expressions(parts)), None))

    def for_loop(self, parts: RuleParts) -> tree.ForLoop:
        """Make the tree of the rule `for_loop`."""
        return tree.ForLoop(*_expressions(parts))

    def constant(self, parts: RuleParts) -> float:
        """Make the tree of the rule `constant`."""
        return _finite(parts[-1]) * (-1.0 if parts[0] == "-" else 1.0)

    def case_values(self, parts: RuleParts) -> tree.CaseValues:
        """Make the tree of the rule `case_values`."""
        return tree.CaseValues(tuple(_expressions(parts)))

    def call(self, parts: RuleParts) -> tree.ProgramCall:
        """Make the tree of the rule `call`."""
        return tree.ProgramCall(parts[1].lower(), parts[2] if len(parts) > 2 else (), _column(parts[1]))

    def reaction(self, parts: RuleParts) -> tree.Reaction:
        """Make the tree of the rule `reaction`."""
        word, signal, program, *priority = parts
        return tree.Reaction(word.upper(), signal, program.lower(), next(iter(priority), None), _column(program))

    def reacte(self, parts: RuleParts) -> tree.Reaction:
        """Make the tree of the rule `reacte`."""
        return tree.Reaction("REACTE", None, parts[1].lower(), column=_column(parts[1]))

    def pcexecute(self, parts: RuleParts) -> tree.ProcessStart:
        """Make the tree of the rule `pcexecute`."""
        return tree.ProcessStart(parts[1].lower(), next(iter(parts[2:]), None), _column(parts[1]))

    def type_out(self, parts: RuleParts) -> tree.TypeOut:
        """Make the tree of the rule `type_out`."""
        return tree.TypeOut(tuple(_expressions(parts)))

    def prompt(self, parts: RuleParts) -> tree.PromptFor:
        """Make the tree of the rule `prompt`."""
        return tree.PromptFor(parts[1][1:-1], parts[2])


def _finite(token: Token) -> float:
    value = float(token)
    if not isfinite(value):
        raise ProgramError("the number is too large", column=_column(token))
    return value
