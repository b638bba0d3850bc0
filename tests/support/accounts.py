"""A second account on this machine: what it does is done by a forked child that has dropped to it.

Only root can drop to another account. Continuous integration (`CI` in its environment) has to be root; elsewhere these
tests say that they cannot run.
"""

from __future__ import annotations

import os
from collections.abc import Callable

import pytest

OTHER = 65534  # nobody

needs_root = pytest.mark.skipif(
    os.geteuid() != 0 and "CI" not in os.environ, reason="only root can act as a second account (CI does)"
)


def as_other_account(action: Callable[[], object], group: int = OTHER) -> str:
    """What `action` gives, or the error it ends in, as text: "LinkError: ..."."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.write(write, _attempt(action, group).encode()[:4096])
        os._exit(0)
    os.close(write)
    with open(read, "rb") as pipe:
        said = pipe.read().decode()
    os.waitpid(child, 0)
    return said


def _attempt(action: Callable[[], object], group: int) -> str:
    try:
        os.setgroups([])
        os.setresgid(group, group, group)
        os.setresuid(OTHER, OTHER, OTHER)
        return str(action())
    except BaseException as error:
        return f"{type(error).__name__}: {error}"
