"""Trees as text: `parse_line(print_line(line)) == line`. Keywords in capitals, names in lower case."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from qrobot.val import tree

_LEVELS: Final = (("OR",), ("AND",), ("NOT",), ("==", "<>", "<", "<=", ">", ">="), ("+", "-"), ("*", "/", "MOD"))
_SIGN: Final = len(_LEVELS)  # of a number, binds closer than these
_COMPOUND: Final = _SIGN + 1
_ATOM: Final = _COMPOUND + 1
INDENT: Final = "    "


def print_line(line: tree.ProgramLine) -> str:
    """One step as it may stand in a file."""
    parts = [] if line.label is None else [str(line.label)]
    parts += [] if line.action is None else [print_action(line.action)]
    parts += [] if line.comment is None else [f";{line.comment}"]
    return " ".join(parts)


def print_program(program: tree.ValProgram) -> str:
    """A program from `.PROGRAM` to `.END`."""
    head = f".PROGRAM {program.name}({', '.join(program.parameters)})"
    return "\n".join([head, *(f"{INDENT}{print_line(line)}".rstrip() for line in program.lines), ".END", ""])


def print_expression(expression: tree.Expression, level: int = 0) -> str:
    """An expression, in parentheses when it binds looser than `level` asks."""
    text, own = _expression(expression)
    return f"({text})" if own < level else text


def print_number(value: float) -> str:
    """The shortest text that gives the same number."""
    return f"{value:.0f}" if value == int(value) and abs(value) < 1e15 else repr(value)


def print_action(action: tree.StepAction) -> str:  # noqa: PLR0911 (one form for each)
    """The action of a line, without its label."""
    match action:
        case tree.Instruction(word=word, arguments=arguments, always=always):
            return _joined(word, _arguments(arguments), "ALWAYS" if always else "")
        case tree.SpeedSetting(value=value, in_mm_s=in_mm_s, always=always):
            return _joined("SPEED", print_expression(value), "MMPS" if in_mm_s else "", "ALWAYS" if always else "")
        case tree.Assignment(target=target, value=value, location=location):
            return _joined("SET" if location else "", print_expression(target), "=", print_expression(value))
        case tree.NumberedAssignment(word=word, number=number, value=value):
            return f"{word} {print_expression(number)} = {print_expression(value)}"
        case tree.ParameterSetting(name=name, value=value):
            return f"PARAMETER {name} = {print_expression(value)}"
        case tree.SwitchSetting(on=on, switches=switches):
            return f"{'ENABLE' if on else 'DISABLE'} {', '.join(switches)}"
        case tree.Decomposition(target=target, location=location):
            return f"DECOMPOSE {target}[] = {print_expression(location)}"
        case tree.TypeOut(items=items):
            return _joined("TYPE", ", ".join(_item(item) for item in items))
        case tree.PromptFor(text=text, target=target):
            return f'PROMPT "{text}", {print_expression(target)}'
        case _:
            return _flow(action)


def _flow(action: tree.StepAction) -> str:  # noqa: PLR0911 (one form for each)
    match action:
        case tree.Goto(label=label, condition=None):
            return f"GOTO {label}"
        case tree.Goto(label=label, condition=condition) if condition is not None:
            return f"IF {print_expression(condition)} GOTO {label}"
        case tree.Block(word=word, condition=condition):
            behind = {"IF": "THEN", "WHILE": "DO", "CASE": "OF"}.get(word, "")
            return _joined(word, "" if condition is None else print_expression(condition), behind)
        case tree.ForLoop(variable=variable, first=first, last=last, step=step):
            head = f"FOR {print_expression(variable)} = {print_expression(first)} TO {print_expression(last)}"
            return head if step is None else f"{head} STEP {print_expression(step)}"
        case tree.CaseValues(values=values):
            return f"VALUE {', '.join(map(print_number, values))}:"
        case tree.ProgramCall(program=program, arguments=arguments):
            return f"CALL {program}" + (f"({_arguments(arguments)})" if arguments else "")
        case tree.Reaction(word=word, signal=signal, program=program, priority=priority):
            return f"{word} {_listed(signal, program, priority)}"
        case tree.ProcessStart(program=program, cycles=cycles):
            return f"PCEXECUTE {_listed(program, cycles)}"
    raise TypeError(f"{action!r} is no action")


def _joined(*words: str) -> str:
    return " ".join(word for word in words if word)


def _listed(*parts: tree.Expression | str | None) -> str:
    return ", ".join(part if isinstance(part, str) else print_expression(part) for part in parts if part is not None)


def _arguments(arguments: Sequence[tree.Expression | None]) -> str:
    return ", ".join("" if argument is None else print_expression(argument) for argument in arguments)


def _item(item: tree.Expression | tree.OutputFormat) -> str:
    return f"/{item.code}" if isinstance(item, tree.OutputFormat) else print_expression(item)


def _expression(expression: tree.Expression) -> tuple[str, int]:  # noqa: PLR0911 (one form for each)
    """Its text, and how closely it binds."""
    match expression:
        case tree.NumberLiteral(value=value):
            return print_number(value), _ATOM
        case tree.TextLiteral(value=value):
            return f'"{value}"', _ATOM
        case tree.VariableName(name=name, indices=indices):
            return name + (f"[{_arguments(indices)}]" if indices else ""), _ATOM
        case tree.GroupedVariable(variable=variable):
            return f"({print_expression(variable)})", _ATOM
        case tree.FunctionCall(name=name, arguments=arguments):
            return f"{name}({_arguments(arguments)})", _ATOM
        case tree.LocationChange(name=name, location=location, by=by):
            return f"{name}({print_expression(location)} BY {_arguments(by)})", _ATOM
        case tree.UnaryOperation(operator="NOT", operand=operand):
            return f"NOT {print_expression(operand, 2)}", 2
        case tree.UnaryOperation(operator=operator, operand=operand):
            return f"{operator}{print_expression(operand, _SIGN)}", _SIGN
        case tree.BinaryOperation(operator=operator, left=left, right=right):
            own = _level(operator)
            between = operator if operator == ":" else f" {operator} "
            return f"{print_expression(left, own)}{between}{print_expression(right, own + 1)}", own


def _level(operator: str) -> int:
    if operator == ":":
        return _COMPOUND
    return next(level for level, operators in enumerate(_LEVELS) if operator in operators)
