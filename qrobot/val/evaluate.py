"""Values of expressions. TRUE is -1 and FALSE 0, angles are degrees, as in VAL II."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final, Protocol

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import ProgramError
from qrobot.model.transform import inverse, transform
from qrobot.units import DEG_PER_RAD, M_PER_MM, MM_PER_M, RAD_PER_DEG
from qrobot.val import tree
from qrobot.val.values import (
    FALSE,
    TRUE,
    JointLocation,
    Transformation,
    ValValue,
    joint_location,
    transformation,
    within_reason,
)
from qrobot.val.vocabulary import LOCATION_VALUES, NUMBER_VALUES

LARGEST_INDEX: Final = 1_000_000  # [A]
LARGEST_WHOLE: Final = 2**31  # [A]
_UNSET: Final = "the value of {} is not defined"


class KindError(ProgramError):
    """A location stands where a number is wanted, or the other way round."""


class Surroundings(Protocol):
    """The state that an expression is evaluated in."""

    @property
    def robot(self) -> Robot:
        """The arm."""

    def value(self, name: str, indices: tuple[int, ...]) -> ValValue | None:
        """A variable's value, None when it has none."""

    def frame(self, name: str) -> Floats:
        """HERE, DEST, NULL, TOOL or BASE, as a pose (4, 4)."""

    def signal_is_on(self, number: int) -> bool:
        """Whether a signal is on. Raises ProgramError when there is none of that number."""

    def number_function(self, name: str, arguments: Sequence[float]) -> float:
        """TIMER, SPEED or RANDOM."""

    def pose_of(self, location: Transformation | JointLocation) -> Floats:
        """Pose (4, 4) of the tool in the world."""

    def reaches(self, location: Transformation | JointLocation) -> bool:
        """Whether the arm gets there."""


def number_of(expression: tree.Expression, around: Surroundings) -> float:
    """The number of an expression. Raises ProgramError when it has none, or is a location."""
    value = evaluate(expression, around)
    if isinstance(value, float):
        return value
    raise KindError("expected a number, not a location", column=getattr(expression, "column", 0))


def whole_number_of(expression: tree.Expression, around: Surroundings) -> int:
    """The whole number of an expression. Raises ProgramError when it is none."""
    value = number_of(expression, around)
    if value != int(value):
        raise ProgramError(f"expected a whole number, not {value:g}", column=getattr(expression, "column", 0))
    if abs(value) > LARGEST_WHOLE:
        raise ProgramError(f"{value:g} is too large a whole number", column=getattr(expression, "column", 0))
    return int(value)


def location_of(expression: tree.Expression, around: Surroundings) -> Transformation | JointLocation:
    """The location of an expression. Raises ProgramError when it has none, or is a number."""
    value = evaluate(expression, around)
    if isinstance(value, float):
        raise KindError("expected a location, not a number", column=getattr(expression, "column", 0))
    return value


def pose_of(expression: tree.Expression, around: Surroundings) -> Floats:
    """The pose (4, 4) of a location; that of a precision point is the tool's, in the world."""
    value = location_of(expression, around)
    return value.T if isinstance(value, Transformation) else around.pose_of(value)


def is_true(expression: tree.Expression, around: Surroundings) -> bool:
    """Whether an expression is other than 0."""
    return number_of(expression, around) != FALSE


def indices_of(variable: tree.VariableName, around: Surroundings) -> tuple[int, ...]:
    """Indices of an element as numbers. Raises ProgramError when one is negative or too large."""
    indices = tuple(whole_number_of(index, around) for index in variable.indices)
    if any(not 0 <= index <= LARGEST_INDEX for index in indices):
        raise ProgramError(f"indices of {variable.name} are 0 to {LARGEST_INDEX}", column=variable.column)
    return indices


def evaluate(expression: tree.Expression, around: Surroundings) -> ValValue:  # noqa: PLR0911 (one for each)
    """Number or location. Raises ProgramError: something is not defined, of the wrong kind, or cannot be computed."""
    match expression:
        case tree.NumberLiteral(value=value):
            return value
        case tree.VariableName():
            return _variable(expression, around)
        case tree.GroupedVariable(variable=variable):
            return _variable(variable, around)
        case tree.UnaryOperation(operator=operator, operand=operand):
            return _UNARY[operator](number_of(operand, around))
        case tree.BinaryOperation(operator=":", left=left, right=right):
            return Transformation(pose_of(left, around) @ pose_of(right, around))
        case tree.BinaryOperation(operator=operator, left=left, right=right, column=column):
            x, y = number_of(left, around), number_of(right, around)
            return _finite(operator, _BINARY[operator], x, y, column=column)
        case tree.LocationChange():
            return _changed(expression, around)
        case tree.FunctionCall():
            return _called(expression, around)
        case _:
            raise ProgramError("expected a number or a location, not text")


def _variable(variable: tree.VariableName, around: Surroundings) -> ValValue:
    if not variable.indices and variable.name in NUMBER_VALUES:
        return NUMBER_VALUES[variable.name]
    if not variable.indices and variable.name in LOCATION_VALUES:
        return Transformation(around.frame(variable.name))
    value = around.value(variable.name, indices_of(variable, around))
    if value is None:
        raise ProgramError(_UNSET.format(variable.name), column=variable.column)
    return value


def _truth(holds: bool) -> float:
    return TRUE if holds else FALSE


_UNARY: Final[dict[str, Callable[[float], float]]] = {
    "-": lambda x: -x,
    "+": lambda x: x,
    "NOT": lambda x: _truth(x == FALSE),
}
_BINARY: Final[dict[str, Callable[[float, float], float]]] = {
    "+": lambda x, y: x + y,
    "-": lambda x, y: x - y,
    "*": lambda x, y: x * y,
    "/": lambda x, y: x / y,
    "MOD": math.fmod,
    "==": lambda x, y: _truth(x == y),
    "<>": lambda x, y: _truth(x != y),
    "<": lambda x, y: _truth(x < y),
    "<=": lambda x, y: _truth(x <= y),
    ">": lambda x, y: _truth(x > y),
    ">=": lambda x, y: _truth(x >= y),
    "AND": lambda x, y: _truth(FALSE not in (x, y)),
    "OR": lambda x, y: _truth(x != FALSE or y != FALSE),
}
_OF_NUMBERS: Final[dict[str, Callable[..., float]]] = {
    "ABS": abs,
    "SIN": lambda x: math.sin(x * RAD_PER_DEG),
    "COS": lambda x: math.cos(x * RAD_PER_DEG),
    "ATAN2": lambda y, x: math.atan2(y, x) * DEG_PER_RAD,
    "SQRT": math.sqrt,
    "SQR": lambda x: x * x,
    "INT": lambda x: float(math.trunc(x)),
    "FRACT": lambda x: x - math.trunc(x),
    "SIGN": lambda x: -1.0 if x < 0.0 else 1.0,
    "BCD": lambda x: float(int(str(_small(x)), 16)),
    "DCB": lambda x: float(int(f"{_small(x):x}")),  # of decimal digits: 0x1e5 is no power of ten
}


def _small(x: float) -> int:
    if x != int(x) or not 0 <= x <= 0x9999:
        raise ValueError
    return int(x)


def _finite(name: str, function: Callable[..., float], *values: float, column: int = 0) -> float:
    try:
        result = float(function(*values))
    except (ArithmeticError, ValueError):
        result = math.nan
    if not math.isfinite(result):
        raise ProgramError(f"{_written(name, values)} is no number", column=column)
    return result


def _written(name: str, values: Sequence[float]) -> str:
    """ "1 / 0" of an operator, "SQRT of -1" of a function."""
    numbers = [f"{value:g}" for value in values]
    return f"{numbers[0]} {name} {numbers[1]}" if name in _BINARY else f"{name} of {', '.join(numbers)}"


def _called(call: tree.FunctionCall, around: Surroundings) -> ValValue:  # noqa: PLR0911 (one for each)
    given = call.arguments
    if call.name in _OF_LOCATIONS:
        return _OF_LOCATIONS[call.name]([pose_of(argument, around) for argument in given if argument is not None])
    if call.name == "INRANGE":
        reached = all(around.reaches(location_of(argument, around)) for argument in given if argument is not None)
        return 0.0 if reached else 1.0
    numbers = [0.0 if argument is None else number_of(argument, around) for argument in given]
    if call.name in _OF_NUMBERS:
        return _finite(call.name, _OF_NUMBERS[call.name], *numbers, column=call.column)
    if call.name == "SIG":
        return _truth(all(signal_holds(number, around) for number in numbers))
    if call.name == "BITS":
        return _bits(numbers, around)
    if call.name == "TRANS":
        return transformation((*numbers, *[0.0] * (6 - len(numbers))))
    if call.name == "#PPOINT":
        return joint_location(call.name, numbers, around.robot)
    return around.number_function(call.name, numbers)


def signal_holds(number: float, around: Surroundings) -> bool:
    """Whether a signal is on, or off for a negative number. Raises ProgramError when there is none of that number."""
    if number != int(number) or abs(number) > LARGEST_WHOLE:
        raise ProgramError(f"{number:g} is no signal")
    return around.signal_is_on(abs(int(number))) == (number > 0)


def _bits(numbers: Sequence[float], around: Surroundings) -> float:
    first, count = (int(number) for number in numbers)
    if not 1 <= count <= 16:
        raise ProgramError(f"BITS takes 1 to 16 signals, not {count}")
    return float(sum(around.signal_is_on(first + place) << place for place in range(count)))


def _frame(poses: Sequence[Floats]) -> Transformation:
    """Origin of the last; x from the first to the second, y towards the third."""
    origin, on_x, on_y, at = (pose[:3, 3] for pose in poses)
    x = on_x - origin
    z = np.cross(x, on_y - origin)
    if not (np.linalg.norm(x) > 1e-6 and np.linalg.norm(z) > 1e-9):
        raise ProgramError("FRAME: the three places lie in a line")
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    return Transformation(transform(np.column_stack((x, np.cross(z, x), z)), at))


_OF_LOCATIONS: Final[dict[str, Callable[[Sequence[Floats]], ValValue]]] = {
    "DX": lambda poses: float(poses[0][0, 3] * MM_PER_M),
    "DY": lambda poses: float(poses[0][1, 3] * MM_PER_M),
    "DZ": lambda poses: float(poses[0][2, 3] * MM_PER_M),
    "DISTANCE": lambda poses: float(np.linalg.norm(poses[0][:3, 3] - poses[1][:3, 3]) * MM_PER_M),
    "INVERSE": lambda poses: Transformation(inverse(poses[0])),
    "FRAME": _frame,
}


def _changed(change: tree.LocationChange, around: Surroundings) -> Transformation:
    """SHIFT moves along the axes of the world, SCALE stretches the distance from its origin."""
    T = pose_of(change.location, around).copy()
    by = within_reason([0.0 if argument is None else number_of(argument, around) for argument in change.by])
    if change.name == "SHIFT":
        T[: len(by), 3] += M_PER_MM * np.array(by)
    else:
        T[:3, 3] *= by[0]
    return Transformation(T)
