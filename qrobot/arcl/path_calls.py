"""Calls of a robot that act on the path of its motions: slower, and on after a stop of the servo. Ours [A]."""

from __future__ import annotations

from abc import ABC, abstractmethod
from contextlib import AbstractContextManager
from math import isfinite
from typing import Final

from qrobot.arcl.generator import MotionQueue
from qrobot.arcl.kept_motions import KeptMotions
from qrobot.arcl.machine import RobotMachine
from qrobot.errors import MotionError
from qrobot.motion.kept import WayBackLimit
from qrobot.rci.arguments import as_float, require_torques, retract_m, shown
from qrobot.rci.standstill import PAUSED
from qrobot.units import DEG_PER_RAD, M_PER_MM, MM_PER_M, RAD_PER_DEG

WAY_BACK_MM: Final = WayBackLimit().way_m * MM_PER_M
WAY_BACK_DEG: Final = WayBackLimit().turn * DEG_PER_RAD


class PathCalls(ABC):
    """See above; `ArclRobot` is one.

    Attributes:
        ami: the way to the arm.
    """

    ami: RobotMachine
    _motions: MotionQueue
    _kept: KeptMotions

    @abstractmethod
    def _lock(self) -> AbstractContextManager[object]:
        """Held while motions are touched."""

    def override(self, percent: float) -> None:
        """Let motions go at `percent` of their speed, above 0 to 100, that under way too; places stay the same.

        The operator's override (`qrobot ctl override`) counts besides. Raises MotionError: no such percentage.
        """
        if not _is_number(percent) or not 0.0 < percent <= 100.0:
            raise MotionError(f"override: above 0 to 100 per cent are possible, not {shown(percent)}")
        with self._lock():
            self._motions.override = percent / 100.0

    def keep_path(
        self, keep: bool = True, way_back_mm: float = WAY_BACK_MM, way_back_deg: float = WAY_BACK_DEG
    ) -> None:
        """Let motions outlive a stop of the servo, and a bridge that comes back: they wait until somebody confirms.

        Instead of ServoFault or LinkLost the program sees them stand still (`kept` tells why). After `resume`, or
        `qrobot ctl resume`, a fault is cleared, the arm gets power and goes back to its path at a tenth of its speed,
        as joints go, and the motions go on where they were left. Not kept are motions to goals that move, and those
        being stopped; `stop` and `arcl_close` give the path up. A way back of more than `way_back_mm` at the flange, or
        `way_back_deg` of a joint, is refused: `kept` tells how long it is, and another `keep_path` may allow more.

        Raises:
            MotionError: no such distance or angle, or this machine cannot take an arm again that it has lost.
        """
        for number in (way_back_mm, way_back_deg):
            if not _is_number(number) or not isfinite(as_float(number)) or number < 0.0:
                raise MotionError(f"keep_path: a way back of 0 or more mm and degrees is needed, not {shown(number)}")
        with self._lock():
            self._kept.limit = WayBackLimit(way_back_mm * M_PER_MM, way_back_deg * RAD_PER_DEG)
            self._kept.wanted = bool(keep)
            self.ami.keep_path(self._kept)

    def retract(self, mm: float) -> None:
        """Let the arm go back after a collision, by `mm` of its flange along the path just travelled; 0: stay there.

        When the servo has stopped the arm for COLLISION and holds it, the arm goes back slowly (100 mm/s at most), and
        comes to rest; then the program is told ServoFault, or its motions are kept (`keep_path`). It goes back once:
        what it meets on the way ends that, and so do `stop` and a pause, of the program or the operator. The path is
        remembered from this call on. Other arms of the program do not know of it.

        Raises:
            MotionError: no such distance, or this machine cannot take an arm again that it has lost; or nobody knows
                the arm's torques, which alone tell a collision.
        """
        length_m = retract_m("retract", mm)
        with self._lock():
            require_torques("retract", not length_m or self.ami.sample is None or self.ami.sample.torques_known)
            self.ami.keep_path(self._kept)
            self._kept.retract_m = length_m

    @property
    def kept(self) -> str:
        """Reason for which the arm stands off its path, until somebody confirms that it may go back; else empty."""
        return self._kept.waits(self._motions.paused)

    @property
    def off_path(self) -> bool:
        """The arm is off its path: it waits (`kept`), is led back to it, or goes back from what it met (`retract`)."""
        return self._kept.off_path

    @property
    def halted(self) -> str:
        """Reason for which its motions stand still until somebody lets them go on; empty for none."""
        return self.kept or (PAUSED if self._motions.paused and self._motions.busy else "")

    def pause(self) -> None:
        """Let motions come to a standstill on their path, or on the way back to it, and stay there until `resume`."""
        with self._lock():
            self._motions.paused = True

    def resume(self) -> None:
        """Let motions go on that `pause` holds, and an arm that has left its path (`keep_path`) be led back to it."""
        with self._lock():
            self._motions.paused = False
            self._kept.confirm()


def _is_number(given: object) -> bool:
    return isinstance(given, int | float) and not isinstance(given, bool)
