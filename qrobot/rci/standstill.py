"""A wait on virtual time that nothing can end any more: no arm moves, and nobody is there who could let one go on."""

from __future__ import annotations

from typing import Final

from qrobot.errors import MotionError

HELD_S: Final = 120.0  # [A] of virtual time in which no arm moves: nobody waits for a clock for so long
PAUSED: Final = "the program holds its motions itself (pause, or an override of 0)"


class Standstill:
    """Watches one wait of a program, for how long no arm has moved."""

    def __init__(self) -> None:
        self._since_s: float | None = None

    def lasts(self, now_s: float, moving: bool) -> bool:
        """Whether no arm has moved for longer than anybody waits for a clock. To be asked at each sample."""
        if moving or self._since_s is None:
            self._since_s = now_s
        return now_s - self._since_s > HELD_S


def nobody_resumes(name: str, reason: str) -> MotionError:
    """Error of a wait for an arm whose motions stand still for `reason`, until somebody lets them go on."""
    return MotionError(
        f"{name} has stood still for {HELD_S:g} s of virtual time, where the program alone can let it go on (resume): "
        f"{reason}"
    )
