"""Functions as names: a program says which, and a host takes those of the modules that it offers alone."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from typing import Any, Final

from qrobot.errors import ConfigError
from qrobot.rci.task_runner import ControlFunctions, nothing

NOTHING: Final = ""


def name_of(function: Any, task: str) -> str:
    """ "module:name" of a function. Raises ConfigError when another host cannot find it by that."""
    module, name = getattr(function, "__module__", None), getattr(function, "__qualname__", "")
    if function is nothing:
        return NOTHING
    if not module or module == "__main__" or not name.isidentifier():
        raise ConfigError(
            f"{task}: another host finds functions by name: define them in a module that is installed there and "
            f"stands in its list of modules, not in the program itself ({function!r})"
        )
    return f"{module}:{name}"


def function_named(text: str, modules: Sequence[str]) -> Callable[..., Any]:
    """The function of a name. Raises ConfigError for one that this host does not offer."""
    if text == NOTHING:
        return nothing
    module, _, name = text.partition(":")
    if module not in modules:
        raise ConfigError(f"module {module!r} is not offered by this host; it offers {', '.join(modules)}")
    try:
        function = getattr(importlib.import_module(module), name, None)
    except Exception as error:  # whatever the module does when it is imported
        raise ConfigError(f"module {module} fails on this host: {type(error).__name__}: {error}") from error
    if not name.isidentifier() or getattr(function, "__module__", None) != module or not callable(function):
        raise ConfigError(f"module {module} of this host defines no function {name!r}")
    return function  # type: ignore[no-any-return]


def names_of(functions: ControlFunctions, task: str) -> list[str]:
    """The names of a task's functions."""
    return [name_of(each, task) for each in (functions.control1, functions.control2, functions.startup)]
