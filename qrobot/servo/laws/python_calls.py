"""A law that prints or raises is refused before it is compiled: in the cycle both wait for Python, for ever."""

from __future__ import annotations

import dis
from collections.abc import Callable, Iterator
from types import FunctionType
from typing import Any

from qrobot.errors import ConfigError


def refuse_python_calls(function: Callable[..., Any]) -> None:
    """Raises ConfigError when a law, or a function of its file that it calls, prints, raises or asserts."""
    for each in _with_helpers(function, set()):
        for instruction in dis.get_instructions(each):
            if instruction.opname == "RAISE_VARARGS":
                what, instead = "raises", "a torque of NaN stops the arm"
            elif instruction.opname in ("LOAD_GLOBAL", "LOAD_NAME") and instruction.argval == "print":
                what, instead = "prints", "a signal is in the log"
            else:
                continue
            line = instruction.positions.lineno if instruction.positions else each.__code__.co_firstlineno
            raise ConfigError(f"{each.__name__} {what} in line {line}, and so waits for Python in the cycle; {instead}")


def _with_helpers(function: Callable[..., Any], seen: set[FunctionType]) -> Iterator[FunctionType]:
    """A function and those of its file that it calls, compiled ones too."""
    plain = getattr(function, "py_func", function)
    if not isinstance(plain, FunctionType) or plain in seen:
        return
    seen.add(plain)
    yield plain
    for name in plain.__code__.co_names:
        helper = getattr(plain.__globals__.get(name), "py_func", plain.__globals__.get(name))
        if isinstance(helper, FunctionType) and helper.__code__.co_filename == plain.__code__.co_filename:
            yield from _with_helpers(helper, seen)
