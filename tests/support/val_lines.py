"""Lines of VAL II of every form, and the same spoilt at random: each is read, or refused with line and column."""

from __future__ import annotations

import random

from qrobot.errors import ProgramError
from qrobot.val.parser import parse_line
from qrobot.val.printer import print_line

LINES = (
    "10 MOVE a:b[i,2] ; to the part",
    "APPROS #p, 50",
    "x = -3+4*SIN(2) MOD 7",
    "SET #a = HERE",
    "SET a = SHIFT(b:c BY 1,,-3)",
    "SET a = SCALE(b BY .5)",
    "SET f = FRAME(o,x,y,p):INVERSE(TRANS(1,2,3,90))",
    "SPEED 50 MMPS ALWAYS",
    "BASE ,,300",
    "TOOL",
    "IF SIG(1001,-2) AND (x<>3 OR NOT y) GOTO 10",
    "IF x THEN",
    "ELSE",
    "WHILE x >= 1 DO",
    "DO",
    "UNTIL SIG(-1001)",
    "FOR i = 1 TO 10 STEP -2",
    "CASE x OF",
    "VALUE 1, -2.5:",
    "ANY",
    "END",
    "CALL p",
    "CALL q(a, , 3)",
    "RETURN",
    "REACT 1001, p",
    "REACTI -1001, stop.it, 3",
    "REACTE recover",
    "IGNORE 1001",
    "LOCK 3",
    'TYPE /C1, "x; y", /F8.2, x, /X2',
    'PROMPT "how many? ", n[2]',
    "DECOMPOSE x[] = a",
    "TIMER 1 = 0",
    "PARAMETER HAND.TIME = 0.2",
    "PAYLOAD 1.5, 0, , 40",
    "ENABLE CP, DRY.RUN",
    "DISABLE MESSAGES",
    "SIGNAL 1, -2, 2001",
    "NOFLIP ALWAYS",
    "COARSE 50 ALWAYS",
    "PCEXECUTE watch, -1",
    "WAIT TIMER(1) > 2.5E-1",
    "DRIVE 1, -20, 50",
    "; nothing but words",
    "100",
    "",
)

_SIGNS = ("(", ")", "[", ",", ":", "=", "==")
_PIECES = ("MOVE ", "#", *_SIGNS, "1e9", '"', ";", "NOT ", "\x00", "é", ".", " TO ", "/I3", "-")


def spoil_lines(count: int, seed: int) -> tuple[int, int, list[str]]:
    """Numbers of spoilt lines that were refused and that were read, and what went wrong, in words."""
    rng = random.Random(seed)
    refused, wrong = 0, []
    for number in range(1, count + 1):
        text = _spoilt(rng.choice(LINES), rng)
        try:
            line = parse_line(text, number)
        except ProgramError as error:
            refused += 1
            if error.line != number or not 1 <= error.column <= len(text) + 1 or not error.what:
                wrong.append(f"{text!r}: {error}")
        else:
            if parse_line(print_line(line), number) != line:
                wrong.append(f"{text!r} is another line when it is printed")
    return refused, count - refused, wrong


def _spoilt(text: str, rng: random.Random) -> str:
    for _ in range(rng.randint(1, 3)):
        at = rng.randint(0, len(text))
        cut = rng.randint(0, 4)
        text = text[:at] + rng.choice([*_PIECES, "", chr(rng.randint(1, 300))]) + text[at + cut :]
    return text
