"""The robots that a program has open, oldest first."""

from __future__ import annotations

from typing import TYPE_CHECKING

from qrobot.errors import LinkError

if TYPE_CHECKING:
    from qrobot.arcl.robot import ArclRobot

_open: list[ArclRobot] = []


def open_robots() -> list[ArclRobot]:
    """All of them."""
    return list(_open)


def remember(robot: ArclRobot) -> None:
    """Add a robot."""
    _open.append(robot)


def forget(robot: ArclRobot) -> None:
    """Remove a robot."""
    if robot in _open:
        _open.remove(robot)


def newest() -> ArclRobot:
    """The robot that was opened last. Raises LinkError: none is open."""
    if not _open:
        raise LinkError("no robot is open; call arcl_open first")
    return _open[-1]
