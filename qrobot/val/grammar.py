"""The grammar of one line of VAL II, for lark: keywords go before names; locations and numbers share expressions."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from qrobot.val.vocabulary import INNER, INSTRUCTIONS, MANNERS, REACTIONS, STRUCTURE


def _words(*words: str) -> str:
    """A terminal for any of these words, in capitals or not; VAL's names contain dots."""
    longest_first = sorted(words, key=len, reverse=True)
    return rf"/(?:{'|'.join(longest_first)})(?![A-Za-z0-9_.])/i"


def _keywords(words: Iterable[str]) -> str:
    """A terminal for each of these words, by its own name."""
    return "\n".join(f"{word}.3: {_words(word)}" for word in words)


GRAMMAR: Final = rf"""
step: LABEL? action?
only_expression: expression
only_variable: variable

?action: PLAIN arguments                                             -> instruction
    | MANNER expression? ALWAYS?                                     -> manner
    | SIGNAL arguments                                               -> instruction
    | variable "=" expression                                        -> assignment
    | SET location_variable "=" expression                           -> setting
    | SPEED expression MMPS? ALWAYS?                                 -> speed
    | (TIMER | DAC) expression "=" expression                                -> numbered
    | PARAMETER NAME "=" expression                                  -> parameter
    | (ENABLE | DISABLE) NAME ("," NAME)*                            -> switch
    | DECOMPOSE NAME "[" "]" "=" expression                          -> decompose
    | GOTO LABEL                                                     -> goto
    | IF expression GOTO LABEL                                       -> if_goto
    | IF expression THEN                                             -> block
    | WHILE expression DO                                            -> block
    | CASE expression OF                                             -> block
    | UNTIL expression                                               -> block
    | (DO | ELSE | ANY | END)                                        -> block
    | FOR variable "=" expression TO expression (STEP expression)?   -> for_loop
    | VALUE constant ("," constant)* ":"                             -> case_values
    | CALL NAME ("(" arguments ")")?                                 -> call
    | REACTION expression "," NAME ("," expression)?                 -> reaction
    | REACTE NAME                                                    -> reacte
    | PCEXECUTE NAME ("," expression)?                               -> pcexecute
    | TYPE (item ("," item)*)?                                       -> type_out
    | PROMPT TEXT "," variable                                       -> prompt

constant: SIGN? NUMBER
?item: FORMAT -> output_format
    | TEXT -> text
    | expression

arguments: argument ("," argument)*
argument: expression?

?location_variable: variable | PRECISION indices?                    -> variable
variable: NAME indices?
indices: "[" expression ("," expression)* "]"

?expression: conjunction | expression OR conjunction                 -> binary
?conjunction: negation | conjunction AND negation                    -> binary
?negation: comparison | NOT negation                                 -> unary
?comparison: sum | comparison COMPARE sum                            -> binary
?sum: product | sum SIGN product                                     -> binary
?product: signed | product (TIMES | MOD) signed                      -> binary
?signed: compound | SIGN signed                                      -> unary
?compound: atom | compound COLON atom                                -> binary
?atom: NUMBER                                                        -> number
    | NAME indices?                                                  -> value
    | PRECISION indices?                                             -> variable
    | (NAME | PRECISION) "(" arguments ")"                           -> function
    | NAME "(" expression BY arguments ")"                           -> change
    | "(" expression ")"                                             -> grouped

PLAIN.3: {_words(*INSTRUCTIONS)}
MANNER.3: {_words(*MANNERS)}
REACTION.3: {_words(*REACTIONS)}
{_keywords(word for word in (*STRUCTURE, *INNER) if word not in REACTIONS)}
COLON: ":"
SIGN: /[+-]/
TIMES: /[*\/]/
COMPARE: /==|<>|<=|>=|<|>/
LABEL.2: /[0-9]+(?![A-Za-z0-9_.])/
NUMBER: /(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:E[+-]?[0-9]+)?(?![A-Za-z0-9_.])/i
NAME: /[A-Za-z][A-Za-z0-9_.]*/
PRECISION: /#[A-Za-z][A-Za-z0-9_.]*/
TEXT: /"[^"]*"/
FORMAT.2: /\/(?:I[0-9]*|F[0-9]*\.[0-9]+|C[0-9]*|X[0-9]*)(?![A-Za-z0-9_.])/i
%import common.WS_INLINE
%ignore WS_INLINE
"""

DESCRIPTIONS: Final[dict[str, str]] = {
    "LABEL": "a label",
    "NUMBER": "a number",
    "NAME": "a name",
    "PRECISION": "a precision point",
    "TEXT": "text in double quotes",
    "FORMAT": "a format such as /I3",
    "PLAIN": "an instruction",
    "MANNER": "an instruction",
    "REACTION": "an instruction",
    "COLON": "':'",
    "SIGN": "'+' or '-'",
    "TIMES": "'*' or '/'",
    "COMPARE": "a comparison",
    "COMMA": "','",
    "EQUAL": "'='",
    "LPAR": "'('",
    "RPAR": "')'",
    "LSQB": "'['",
    "RSQB": "']'",
    "$END": "the end of the line",
}
"""Terminals in words; the others are keywords, and stand for themselves."""
