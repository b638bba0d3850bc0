"""Arguments of instructions and functions: how many, and of which kind."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields
from typing import Any, Final

from qrobot.errors import ProgramError
from qrobot.val import tree
from qrobot.val.vocabulary import (
    INSTRUCTIONS,
    LOCATION_CHANGES,
    LOCATION_FUNCTIONS,
    LOCATION_VALUES,
    MANNERS,
    NUMBER_FUNCTIONS,
    PARAMETERS,
    SWITCHES,
    UNSUPPORTED_FUNCTIONS,
)

OPEN_ENDED: Final = {"SIG", "SIGNAL", "#PPOINT"}  # one number or more
_SIGNATURES: Final = INSTRUCTIONS | MANNERS
_FUNCTIONS: Final = NUMBER_FUNCTIONS | LOCATION_FUNCTIONS


def check_action(action: tree.StepAction | None) -> None:
    """Raise ProgramError, with the column where it is known, for what the grammar does not see."""
    if action is None:
        return
    match action:
        case tree.Instruction(word=word, arguments=arguments):
            _check_arguments(word, arguments, ("number",) if word in OPEN_ENDED else _SIGNATURES[word])
        case tree.SwitchSetting(switches=switches):
            for switch in switches:
                _check_known(switch, SWITCHES, "switch", "switches")
        case tree.ParameterSetting(name=name):
            _check_known(name, PARAMETERS, "parameter", "parameters")
        case tree.Assignment(target=target, value=value) if target.name.startswith("#") or value is not None:
            _check_assignment(action)
    for expression in expressions_in(action):
        check_expression(expression)


def check_expression(expression: tree.Expression) -> None:
    """Raise ProgramError for a function that is not known, and for arguments of the wrong number or kind."""
    for part in parts_of(expression):
        match part:
            case tree.FunctionCall(name=name, arguments=arguments, column=column):
                _check_function(name, arguments, column)
            case tree.LocationChange(name=name, location=location, by=by, column=column):
                _check_arguments(name, by, LOCATION_CHANGES[name], column)
                _check_kind(name, location, "location", column)
            case tree.BinaryOperation(operator=":", left=left, right=right):
                _check_kind("':'", left, "location")
                _check_kind("':'", right, "location")
            case tree.BinaryOperation(operator=operator, left=left, right=right):
                _check_kind(operator, left, "number")
                _check_kind(operator, right, "number")
            case tree.UnaryOperation(operator=operator, operand=operand):
                _check_kind(operator, operand, "number")


def kind_of(expression: tree.Expression) -> str:
    """ "location" or "number"; "either" for a variable, which only a run can tell."""
    match expression:
        case tree.VariableName(name=name) if name.startswith("#") or name in LOCATION_VALUES:
            return "location"
        case tree.VariableName():
            return "either"
        case tree.GroupedVariable(variable=variable):
            return kind_of(variable)
        case tree.LocationChange() | tree.BinaryOperation(operator=":"):
            return "location"
        case tree.FunctionCall(name=name) if name in LOCATION_FUNCTIONS:
            return "location"
        case _:
            return "number"


def wanted_kinds(action: tree.StepAction) -> Iterator[tuple[tree.Expression, str]]:
    """The expressions of an action whose kind it says: "location" or "number"."""
    match action:
        case tree.Instruction(word=word, arguments=arguments):
            kinds = ("number",) if word in OPEN_ENDED else _SIGNATURES[word]
            yield from (each for each in _with_kinds(arguments, kinds) if each[1] in ("number", "location"))
        case tree.Decomposition(location=location):
            yield location, "location"
        case tree.Assignment(value=value, location=location):
            yield value, "location" if location else "number"
        case tree.TypeOut(items=items):
            numbers = (item for item in items if not isinstance(item, tree.OutputFormat | tree.TextLiteral))
            yield from ((number, "number") for number in numbers)
        case tree.ProgramCall():
            return
        case _:
            yield from ((expression, "number") for expression in expressions_in(action))


def wanted_within(expression: tree.Expression) -> Iterator[tuple[tree.Expression, str]]:
    """Operands, indices and arguments in an expression, each with the kind that is wanted there."""
    for part in parts_of(expression):
        match part:
            case tree.VariableName(indices=indices):
                yield from ((index, "number") for index in indices)
            case tree.FunctionCall(name=name, arguments=arguments):
                yield from _with_kinds(arguments, ("number",) if name in OPEN_ENDED else _FUNCTIONS[name])
            case tree.LocationChange(name=name, location=location, by=by):
                yield location, "location"
                yield from _with_kinds(by, LOCATION_CHANGES[name])
            case tree.BinaryOperation(operator=operator, left=left, right=right):
                yield from ((operand, "location" if operator == ":" else "number") for operand in (left, right))
            case tree.UnaryOperation(operand=operand):
                yield operand, "number"


def _with_kinds(
    arguments: Sequence[tree.Expression | None], kinds: Sequence[str]
) -> Iterator[tuple[tree.Expression, str]]:
    for number, argument in enumerate(arguments):
        if argument is not None:
            yield argument, kinds[min(number, len(kinds) - 1)].rstrip("?")


def expressions_in(action: tree.StepAction) -> Iterator[tree.Expression]:
    """The expressions that stand in an action, not those within them."""
    for each in fields(action):
        yield from _expressions_of(getattr(action, each.name))


def parts_of(expression: tree.Expression) -> Iterator[tree.Expression]:
    """An expression and all that it is made of."""
    yield expression
    for each in fields(expression):
        for part in _expressions_of(getattr(expression, each.name)):
            yield from parts_of(part)


def _expressions_of(value: Any) -> Iterator[tree.Expression]:
    if isinstance(value, tree.Expression):
        yield value
    elif isinstance(value, tuple):
        for each in value:
            yield from _expressions_of(each)


def _check_assignment(action: tree.Assignment) -> None:
    if action.location:
        _check_kind("SET", action.value, "location", action.target.column)
    elif kind_of(action.value) == "location":
        raise ProgramError("expected a number; a location is given by SET", column=action.target.column)
    elif isinstance(action.value, tree.TextLiteral):
        raise ProgramError("expected a number, not text", column=action.target.column)


def _check_function(name: str, arguments: Sequence[tree.Expression | None], column: int) -> None:
    if name in OPEN_ENDED:
        _check_arguments(name, arguments, ("number",), column)
    elif name in _FUNCTIONS:
        _check_arguments(name, arguments, _FUNCTIONS[name], column)
    elif name in UNSUPPORTED_FUNCTIONS:
        raise ProgramError(f"the function {name} is not supported", column=column)
    else:
        raise ProgramError(f"there is no function {name}; elements of arrays have brackets, as in a[1]", column=column)


def _check_arguments(
    word: str, arguments: Sequence[tree.Expression | None], kinds: Sequence[str], column: int = 0
) -> None:
    least = sum(not kind.endswith("?") for kind in kinds)
    if len(arguments) < least or (len(arguments) > len(kinds) and word not in OPEN_ENDED):
        wanted = f"{least}" if least == len(kinds) else f"{least} to {len(kinds)}"
        wanted = "1 or more" if word in OPEN_ENDED else wanted
        plural = "" if wanted == "1" else "s"
        raise ProgramError(f"{word}: expected {wanted} argument{plural}, not {len(arguments)}", column=column or 1)
    for number, argument in enumerate(arguments):
        kind = kinds[min(number, len(kinds) - 1)]
        if argument is not None:
            _check_kind(word, argument, kind.rstrip("?"), column)
        elif not kind.endswith("?"):
            raise ProgramError(f"{word}: argument {number + 1} is left out; expected a {kind}", column=column or 1)


def _check_kind(word: str, expression: tree.Expression, kind: str, column: int = 0) -> None:
    where = getattr(expression, "column", 0) or column or 1
    if kind.endswith("variable") and not isinstance(expression, tree.VariableName):
        raise ProgramError(f"{word}: expected the name of a {kind.removesuffix(' variable')}", column=where)
    wanted, found = kind.removesuffix(" variable"), kind_of(expression)
    if found not in ("either", wanted):
        raise ProgramError(f"{word}: expected a {wanted}, not a {found}", column=where)


def _check_known(name: str, known: Sequence[str], one: str, several: str) -> None:
    if name not in known:
        raise ProgramError(f"there is no {one} {name}; {several} are {', '.join(known)}", column=1)
