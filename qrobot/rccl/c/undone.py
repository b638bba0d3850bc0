"""Words about motions that are not done when a program in C ends."""

from __future__ import annotations

from qrobot.errors import MotionError


def undone(motions: int) -> str:
    """Number of motions that were not done, in words; empty for none."""
    return f"{motions} motion{'s were' if motions > 1 else ' was'} not done" if motions else ""


def terminated(motions: int) -> MotionError:
    """The error with which a program ends that has set `terminate`."""
    left = undone(motions)
    return MotionError(f"the program has set `terminate`{left and ': '}{left}")
