"""Tables of the reference pages that are read from the code: faults, what can break, modes, laws, telemetry."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from qrobot.config import load_robot
from qrobot.faultcodes import EXPLANATION, FaultCode
from qrobot.motion.path import phase
from qrobot.servo import modes
from qrobot.servo.laws.names import DEFAULT_LAW
from qrobot.servo.laws.shipped import LAWS
from qrobot.servo.memory.telemetry import ADDED, ARRAYS, COUNTERS, FACTORS, LINES, SCALARS, TERMS, VECTORS
from qrobot.servo.stop_categories import stop_category
from qrobot.sim_board.faults import KINDS

SERVO: Final = Path(__file__).parents[1] / "qrobot/servo"


def table(headings: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """A Markdown table; bars inside cells are escaped."""
    headings = tuple(headings)
    lines = [headings, ["---"] * len(headings), *rows]
    return "\n".join(
        "| " + " | ".join(re.sub(r"\s*\n\s*", " ", str(cell).strip()).replace("|", r"\|") for cell in line) + " |"
        for line in lines
    )


def faults() -> str:
    """Every code with its number, its stop category, whether anything raises it, what happened and what to do."""
    raised = raised_codes()
    rows = (
        (
            code.value,
            code.name,
            int(stop_category(code)),
            "yes" if code.name in raised else "not yet",
            *EXPLANATION[code],
        )
        for code in sorted(FaultCode)
        if code
    )
    return table(("no.", "code", "category", "detected", "what happened", "what to do"), rows)


def raised_codes() -> set[str]:
    """Names of the codes that the servo raises: those its modules turn into plain numbers for the compiled cycle."""
    return {name for path in SERVO.rglob("*.py") for name in re.findall(r"int\(FaultCode\.(\w+)\)", path.read_text())}


def breakable() -> str:
    """Everything that can be made to break in an emulated board."""
    rows = (
        (
            f"`{kind.address} {kind.name}`",
            "" if kind.default is None else f"{kind.default:g} {kind.unit}",
            f"it {kind.what}",
        )
        for kind in KINDS
    )
    return table(("component and kind", "value, unless given", "what happens"), rows)


def mode_diagram() -> str:
    """The state machine of the servo."""
    return f"```mermaid\n{modes.mermaid()}```"


def phase_diagram() -> str:
    """The phases of a motion."""
    return f"```mermaid\n{phase.mermaid()}```"


def laws() -> str:
    """The shipped laws, by the name that `--law` takes."""
    default = {DEFAULT_LAW: " (default)"}
    robot = load_robot("puma560")
    made = ((name, make(robot)) for name, make in LAWS.items())
    return table(("name", "law"), ((f"`{name}`{default.get(name, '')}", law.__doc__ or "") for name, law in made))


def telemetry() -> str:
    """The fields of one row, in their order."""
    rows = [(f"`{name}`", "int64", meaning) for name, meaning in SCALARS]
    rows += [(f"`{name}`", "float64[n]", meaning) for name, meaning in VECTORS]
    rows += [(f"`{name}`", "int64[n]", meaning) for name, meaning in COUNTERS]
    rows += [(f"`{name}`", "float64[n]", meaning) for name, meaning in TERMS]
    rows += [(f"`{name}`", f"float64[{length}]", meaning) for name, length, meaning in ARRAYS]
    rows += [(f"`{name}`", "int64", meaning) for name, meaning in LINES]
    rows += [(f"`{name}`", f"float64[{length}]", meaning) for name, length, meaning in ADDED]
    rows += [(f"`{name}`", "float64", meaning) for name, meaning in FACTORS]
    return table(("field", "type", "meaning"), rows)
