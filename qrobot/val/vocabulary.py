"""The words of VAL II: instructions with their arguments, functions, switches, and what is not supported.

Sources: the VAL II grammar of a public parser's comments and the V+ guides (see docs/reference/val.md). Arguments are
"location", "number", "variable" and "location variable", with a `?` when they may be left out.
"""

from __future__ import annotations

from typing import Final

INSTRUCTIONS: Final[dict[str, tuple[str, ...]]] = {
    "MOVE": ("location",),
    "MOVES": ("location",),
    "APPRO": ("location", "number"),
    "APPROS": ("location", "number"),
    "DEPART": ("number",),
    "DEPARTS": ("number",),
    "DRIVE": ("number", "number", "number"),
    "ALIGN": (),
    "READY": (),
    "DELAY": ("number",),
    "BREAK": (),
    "BRAKE": (),
    "OPEN": (),
    "OPENI": (),
    "CLOSE": (),
    "CLOSEI": (),
    "HERE": ("location variable",),
    "TOOL": ("location?",),
    "BASE": ("number?", "number?", "number?", "number?"),
    "WAIT": ("number",),
    "IGNORE": ("number",),
    "LOCK": ("number",),
    "RESET": (),
    "RUNSIG": ("number?",),
    "PAYLOAD": ("number", "number?", "number?", "number?"),
    "RETURN": (),
    "PAUSE": (),
    "STOP": (),
    "HALT": (),
}
"""By their word. SIGNAL takes any number of numbers."""

MANNERS: Final[dict[str, tuple[str, ...]]] = {
    "RIGHTY": (),
    "LEFTY": (),
    "ABOVE": (),
    "BELOW": (),
    "FLIP": (),
    "NOFLIP": (),
    "COARSE": ("number?",),
    "FINE": ("number?",),
    "NULL": (),
    "NONULL": (),
}
"""Those that may have ALWAYS behind them."""

REACTIONS: Final = ("REACT", "REACTI")
STRUCTURE: Final = (
    *("IF", "THEN", "ELSE", "WHILE", "DO", "UNTIL", "FOR", "TO", "STEP", "CASE", "OF", "VALUE", "ANY", "END", "GOTO"),
    *("CALL", "SET", "SPEED", "TIMER", "DAC", "PARAMETER", "ENABLE", "DISABLE", "DECOMPOSE", "TYPE", "PROMPT"),
    "PCEXECUTE",
    *("SIGNAL", "REACT", "REACTI", "REACTE", "AND", "OR", "NOT", "MOD"),
)
INNER: Final = ("BY", "MMPS", "ALWAYS")
"""Words of a line that mean something in their place alone."""
RESERVED: Final = frozenset({*INSTRUCTIONS, *MANNERS, *STRUCTURE})
"""Words that begin or divide a line, so that nothing else can be called like them there."""

FORMS: Final[dict[str, str]] = {
    "IF": "IF value THEN, or IF value GOTO label",
    "WHILE": "WHILE value DO",
    "UNTIL": "UNTIL value",
    "FOR": "FOR variable = first TO last STEP step",
    "CASE": "CASE value OF",
    "VALUE": "VALUE number, number:",
    "GOTO": "GOTO label",
    "CALL": "CALL program(value, value)",
    "SET": "SET location variable = location",
    "SPEED": "SPEED number, then MMPS and ALWAYS if need be",
    "TIMER": "TIMER number = number",
    "DAC": "DAC output = volts",
    "PARAMETER": "PARAMETER name = number",
    "ENABLE": "ENABLE switch",
    "DISABLE": "DISABLE switch",
    "DECOMPOSE": "DECOMPOSE name[] = location",
    "TYPE": 'TYPE "text", /F8.2, value',
    "PROMPT": 'PROMPT "text", variable',
    "PCEXECUTE": "PCEXECUTE program, cycles",
    "SIGNAL": "SIGNAL number, number",
    "REACT": "REACT signal, program, priority",
    "REACTI": "REACTI signal, program, priority",
    "REACTE": "REACTE program",
}
"""Form of a line that begins with a word, for those whose arguments are no plain list."""


def taken(name: str) -> str:
    """Reason for which `name` is no variable; "" when it may be one."""
    if name in LOCATION_VALUES or name in NUMBER_VALUES or name in PLAIN_FUNCTIONS or name == "not":
        return f"{name.upper()} is a word of VAL and cannot be given a value: choose another name"
    return ""


def form_of(word: str) -> str:
    """Form of a line that begins with `word`, in capitals; "" for one that has nothing behind it."""
    arguments = INSTRUCTIONS.get(word) or MANNERS.get(word) or ()
    listed = f"{word} {', '.join(kind.removesuffix('?') for kind in arguments)}" if arguments else ""
    return FORMS.get(word, listed)


UNSUPPORTED: Final = frozenset(
    {
        *("GRASP", "DRAW", "MOVET", "MOVEST", "MOVESF", "MOVEF", "NEST", "IFSIG", "ALTER", "ALTOUT", "NOALTER"),
        *("RELAX", "RELAXI", "SHIFT", "INVERT", "INVERSE", "FRAME", "TYPEI", "GOSUB", "SETI", "INT", "CYCLE", "ADC"),
        *("ATTACH", "DETACH", "BITS", "EDIT", "DURATION", "ACCEL", "SINGLE", "MULTIPLE", "READ", "WRITE", "PCEND"),
        *("PCABORT", "PENDANT", "WEAVE", "NOOVERLAP", "OVERLAP", "INTON", "INTOFF", "INTOFF", "CPON", "CPOFF"),
    }
)
"""Instructions of VAL, VAL II and V+ that are known by name only."""

NUMBER_FUNCTIONS: Final[dict[str, tuple[str, ...]]] = {
    "ABS": ("number",),
    "SIN": ("number",),
    "COS": ("number",),
    "ATAN2": ("number", "number"),
    "SQRT": ("number",),
    "SQR": ("number",),
    "INT": ("number",),
    "FRACT": ("number",),
    "SIGN": ("number",),
    "DX": ("location",),
    "DY": ("location",),
    "DZ": ("location",),
    "DISTANCE": ("location", "location"),
    "INRANGE": ("location",),
    "TIMER": ("number",),
    "SPEED": ("number?",),
    "BITS": ("number", "number"),
    "BCD": ("number",),
    "DCB": ("number",),
    "RANDOM": (),
}
"""SIG takes any number of numbers."""
PLAIN_FUNCTIONS: Final = frozenset({"random"})
"""Functions that stand without parentheses, as V+ writes them."""

LOCATION_FUNCTIONS: Final[dict[str, tuple[str, ...]]] = {
    "TRANS": ("number?", "number?", "number?", "number?", "number?", "number?"),
    "FRAME": ("location", "location", "location", "location"),
    "INVERSE": ("location",),
    "#PPOINT": ("number",),
}
"""#PPOINT takes as many numbers as the arm has joints."""

LOCATION_CHANGES: Final[dict[str, tuple[str, ...]]] = {"SHIFT": ("number?", "number?", "number?"), "SCALE": ("number",)}
LOCATION_VALUES: Final = frozenset({"here", "dest", "null", "tool", "base"})
NUMBER_VALUES: Final[dict[str, float]] = {"true": -1.0, "false": 0.0, "on": -1.0, "off": 0.0, "pi": 3.141592653589793}
UNSUPPORTED_FUNCTIONS: Final = frozenset({"STATE", "ERROR", "ADC", "LEN", "ASC", "VAL", "TASK", "STATUS", "LAST"})

SWITCHES: Final = ("CP", "DRY.RUN", "TRACE", "MESSAGES", "COMPLY")
PARAMETERS: Final = ("HAND.TIME", "COLLISION", "RETRACT")

OUTPUTS: Final = range(1, 17)
INPUTS: Final = range(1001, 1033)
INTERNAL: Final = range(2001, 2033)
ANALOG_OUTPUTS: Final = range(1, 9)
"""Numbers of signals, recalled; the outputs are as many as the wire to the robot has."""


MOVING: Final = frozenset(
    {
        *("MOVE", "MOVES", "APPRO", "APPROS", "DEPART", "DEPARTS", "DRIVE", "ALIGN", "READY", "DELAY"),
        *("BREAK", "BRAKE", "OPEN", "OPENI", "CLOSE", "CLOSEI", "TOOL", "BASE"),
    }
)
"""Instructions that a process control program may not give."""


def moves_nothing(word: str) -> str:
    """Words for an instruction of `MOVING` in a process control program."""
    instead = "; to wait there: TIMER 1 = 0, and WAIT TIMER(1) > seconds" if word == "DELAY" else ""
    return f"{word}: a process control program moves nothing{instead}"
