"""Lines of VAL II to trees, and their errors in words: column, what was expected, what stands there."""

from __future__ import annotations

import re
from functools import cache
from typing import Any, Final

from lark import Lark
from lark.exceptions import UnexpectedCharacters, UnexpectedInput, UnexpectedToken, VisitError

from qrobot.errors import ProgramError
from qrobot.printable import printable
from qrobot.val.grammar import DESCRIPTIONS, GRAMMAR
from qrobot.val.signatures import check_action, check_expression
from qrobot.val.tree import Expression, ProgramLine, VariableName
from qrobot.val.tree_builder import TreeBuilder
from qrobot.val.vocabulary import RESERVED, UNSUPPORTED, form_of

LONGEST_LINE: Final = 400  # characters [A]; VAL's terminals had 80
DEEPEST: Final = 40  # parentheses in one another [A]
MOST_TOLD: Final = 6  # of what was expected
_FIRST_WORD: Final = re.compile(r"\s*(?:[0-9]+\s+)?([A-Za-z][A-Za-z0-9_.]*)\s*([=\[]?)")
_REFUSED: Final = {
    "$": "variables of text ($) are not supported; TYPE and PROMPT take text in double quotes",
    '"': "the text has no closing quote, or text cannot stand here",
}
_OPERATORS: Final = {"SIGN", "TIMES", "MOD", "COMPARE", "AND", "OR", "COLON", "BY"}
_OF_NAMES: Final = {"LPAR", "LSQB"}  # behind a name: a function, an element
_VALUES: Final = {"NUMBER", "NAME", "PRECISION", "LPAR"}


def parse_line(text: str, line: int = 0) -> ProgramLine:
    """One step of a program. Raises ProgramError with `line`, column, and what was expected."""
    step, comment = _without_comment(text)
    if step.strip() == "":
        return ProgramLine(comment=comment, line=line)
    column = _first_column(step)
    try:
        _check_first_word(step)
        label, action = _parse(step, "step")
        check_action(action)
    except ProgramError as error:
        form = _form(step) if "expected" in error.what else ""
        raise ProgramError(error.what + form, line, max(error.column, column)) from None
    return ProgramLine(action, label, comment, line, column)


def parse_expression(text: str) -> Expression:
    """An expression by itself. Raises ProgramError."""
    found: Expression = _parse(text, "only_expression")
    check_expression(found)
    return found


def parse_variable(text: str) -> VariableName:
    """A variable or precision point by itself. Raises ProgramError."""
    found = parse_expression(text)
    if not isinstance(found, VariableName):
        raise ProgramError(f"a name is needed, not {printable(text.strip())!r}", column=1)
    return found


@cache
def _parser() -> Lark:
    return Lark(GRAMMAR, parser="lalr", start=["step", "only_expression"], propagate_positions=False)


def _parse(text: str, start: str) -> Any:
    if len(text) > LONGEST_LINE:
        raise ProgramError(f"a line has at most {LONGEST_LINE} characters, this has {len(text)}", column=LONGEST_LINE)
    _check_depth(text)
    try:
        return TreeBuilder().transform(_parser().parse(text, start=start))
    except UnexpectedInput as error:
        raise _told(error, text) from None
    except VisitError as error:
        if isinstance(error.orig_exc, ProgramError):
            raise error.orig_exc from None
        raise


def _without_comment(text: str) -> tuple[str, str | None]:
    """Split a line at the first semicolon that is not between quotes; None for no comment."""
    quoted = False
    for place, character in enumerate(text):
        quoted ^= character == '"'
        if character == ";" and not quoted:
            return text[:place].rstrip(), text[place + 1 :].rstrip()
    return text.rstrip(), None


def _first_column(text: str) -> int:
    """Column of the first word behind the label; 0 for none."""
    found = _FIRST_WORD.match(text)
    return 0 if found is None else found.start(1) + 1


def _form(text: str) -> str:
    """Form of a line that begins with the word that this one begins with; "" where there is nothing to tell."""
    found = _FIRST_WORD.match(text)
    form = "" if found is None or found[2] else form_of(found[1].upper())
    return f"; write {form}" if form else ""


def _check_first_word(text: str) -> None:
    """Refuse by name what is no instruction, or one that is not supported."""
    found = _FIRST_WORD.match(text)
    if found is None:
        return
    word, behind, column = found[1].upper(), found[2], found.start(1) + 1
    if word in RESERVED or behind:
        return
    if word in UNSUPPORTED:
        raise ProgramError(f"{word} is not supported", column=column)
    raise ProgramError(f"{printable(found[1])} is no instruction; expected one, or `name = value`", column=column)


def _check_depth(text: str) -> None:
    """Refuse what would nest deeper than Python's own stack bears."""
    depth = 0
    for place, character in enumerate(text):
        depth += (character in "([") - (character in ")]")
        if depth > DEEPEST:
            raise ProgramError(f"parentheses may stand {DEEPEST} deep in one another", column=place + 1)


def _told(error: UnexpectedInput, text: str) -> ProgramError:
    column = max(1, error.column if isinstance(error.column, int) and error.column > 0 else len(text) + 1)
    if isinstance(error, UnexpectedToken):
        found = "the line ends" if error.token.type == "$END" else f"{printable(str(error.token))!r} stands"
        if error.token.type == "$END":
            column = len(text.rstrip()) + 1
        return ProgramError(f"expected {_expected(error.accepts or error.expected)}; {found} there", column=column)
    if isinstance(error, UnexpectedCharacters):
        there = printable(text[column - 1 : column])
        if there in _REFUSED:
            return ProgramError(_REFUSED[there], column=column)
        return ProgramError(f"expected {_expected(error.allowed or set())}; {there!r} stands there", column=column)
    return ProgramError("the line cannot be read", column=column)


def _expected(terminals: set[str]) -> str:
    """Terminals in words, the likeliest first."""
    left = set(terminals)
    words = []
    if left >= _VALUES:
        left -= {*_VALUES, "SIGN", "NOT"}
        words.append("a value")
    elif left >= _VALUES - {"NUMBER", "LPAR"}:
        left -= {"NAME", "PRECISION"}
        words.append("a name")
    elif len(left & _OPERATORS) > 0 and left != {"COLON"}:
        left -= _OPERATORS | (_OF_NAMES if left - _OPERATORS - _OF_NAMES else set())
        words += ["an operator"]
    closing = sorted({DESCRIPTIONS.get(name, name) for name in left}, key=lambda word: (word.isupper(), word))
    words = [*closing, *words] if words == ["an operator"] else [*words, *closing]
    told = words[:MOST_TOLD]
    more = " or something else" if len(words) > MOST_TOLD else ""
    return (" or ".join(told) or "nothing more") + more
