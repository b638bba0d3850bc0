"""Children that a program forks: they have no part in its arms.

A child of `os.fork` has copies of the program's connections and of what is done at its end. It must neither say goodbye
on the ones nor do the other, and what it asks of an arm is refused. (`subprocess` gives its children nothing of that;
`multiprocessing` forks on Linux, until Python 3.14.)
"""

from __future__ import annotations

import os
from typing import Final, Protocol
from weakref import WeakSet

NO_PART: Final = "a child that the program has forked has no part in its arms: let the program itself move them"


class Owned(Protocol):
    """A thing of the process that has made it, in which children of that have no part."""

    def forget_in_child(self) -> object:
        """Be without effect from now on, in a child that was forked just now: no thread but this one is there."""


_owned: Final[WeakSet[Owned]] = WeakSet()


def keep_from_children(thing: Owned) -> None:
    """Let children that are forked from now on forget `thing`."""
    _owned.add(thing)


def _forget_all() -> None:
    for thing in list(_owned):
        thing.forget_in_child()


os.register_at_fork(after_in_child=_forget_all)
