"""Descriptors of the tasks by which programming libraries move arms, as tasks of RCI in the same process find them.

They are in no table of tasks: such a task begins and ends with the library's hold of its arm, at any time.
"""

from __future__ import annotations

from typing import Final

from qrobot.rci.descriptor import TaskDescriptor

_held: Final[list[TaskDescriptor]] = []


def hold(td: TaskDescriptor) -> None:
    """A library has its arm under control, or is about to."""
    _held.append(td)


def let_go(td: TaskDescriptor) -> None:
    """The library has let go of its arm, or lost it; does nothing a second time."""
    _held[:] = [other for other in _held if other is not td]


def held(name: str) -> TaskDescriptor | None:
    """The descriptor of that name, the newest of several; None when no library holds such an arm."""
    return next((td for td in reversed(_held) if td.name == name), None)
