"""The motions of a robot whose arm is off their path: it goes back from what it met, or they wait for its way back."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from qrobot.arcl.kinematics import ManipulatorKinematics
from qrobot.arcl.machine import MachineSample
from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import LinkError, MotionError, ServoFault
from qrobot.motion.kept import KeptPath, Retreat, WayBackLimit, kept_path

if TYPE_CHECKING:
    from qrobot.arcl.generator import MotionQueue


class KeptMotions:
    """See `PathKeeper`, which the machine calls; the queue asks it for setpoints on the way back.

    Args:
        robot: the arm.

    Attributes:
        wanted: a stop of the servo does not end control of the arm.
        limit: how far the arm is led back.
        retract_m: how far the flange goes back after a collision, m; 0 for not at all.
    """

    _queue: MotionQueue
    _kinematics: ManipulatorKinematics

    def __init__(self, robot: Robot) -> None:
        self.wanted, self.limit = False, WayBackLimit()
        self.retract_m, self._retreat = 0.0, Retreat()
        self._robot = robot
        self._path: KeptPath | None = None

    def serve(self, queue: MotionQueue, kinematics: ManipulatorKinematics) -> None:
        """The motions are those of `queue` from now on; the arm, which has these kinematics, is on their path."""
        self._queue, self._kinematics, self._path = queue, kinematics, None
        self._retreat.forget()
        queue.kept = self

    @property
    def off_path(self) -> bool:
        """The arm goes back from what it met, waits off its path, or is led back to it."""
        return self._path is not None or self._retreat.fault is not None

    @property
    def reason(self) -> str:
        """Reason for which the arm stands off its path, until somebody confirms that it may go back; else empty."""
        return "" if self._path is None or self._path.confirmed else str(self._path.reason)

    def waits(self, paused: bool) -> str:
        """Reason for which the arm stands off its path, also on the way back when it is `paused` there; else empty."""
        reason = None if self._path is None else self._path.waits(paused)
        return "" if reason is None else str(reason)

    def confirm(self) -> None:
        """The arm may be led back; does nothing when it is on its path."""
        if self._path is not None:
            self._path.confirmed = True

    def give_up(self, seconds: float) -> None:
        """Stop on the way back, in at least `seconds`; what waits will not be done."""
        if self._retreat.fault is not None:
            self._retreat.stop()
        if self._path is not None:
            self._path.give_up(seconds)

    def keep(self, fault: ServoFault | LinkError, held: bool) -> bool:
        """See `PathKeeper.keep`."""
        if self._retreat.wanted(fault, self.retract_m if self._may_retract(held) else 0.0):
            return True
        if self._path is None and self.wanted:
            self._path = kept_path(self._queue.engine, self._kinematics, self._queue.tick, fault)
        if self._path is None or self._path.given_up:
            return False
        self._path.wait_again(fault)
        return True

    def _may_retract(self, held: bool) -> bool:
        """Whether the arm, which was on its path, is not wanted at rest."""
        return self._path is None and not (held or self._queue.paused or self._queue.engine.stopping)

    def look(self, seen: MachineSample, paused: bool) -> None:
        """See `PathKeeper.look`."""
        if self.off_path:
            self._queue.count(seen)
        if self._path is not None:
            self._path.hear(paused, self._queue.tick)
            self.insist()

    def insist(self) -> None:
        """See `PathKeeper.insist`."""
        if self._path is not None and self._path.given_up:
            raise self._path.fault

    def may_return(self, seen: MachineSample) -> bool:
        """See `PathKeeper.may_return`."""

        def objection_to(goal: Floats) -> MotionError | None:
            return self.limit.objection(self._robot, self._kinematics.forward, seen.q, goal)

        if self._path is None:
            return self._retreat.fault is not None
        return self._path.confirmed and self._path.judge(objection_to)

    def lead_back(self, q: Floats) -> None:
        """See `PathKeeper.lead_back`."""
        if self._path is not None:
            self._path.lead_back(self._queue.engine_at, np.array(q))
        else:
            self._retreat.begin(np.array(q), self._kinematics.limits, self._queue.period_s, self._kinematics.forward)

    @property
    def met(self) -> ServoFault | LinkError | None:
        """See `PathKeeper.met`."""
        return self._retreat.over

    def note(self, q: Floats) -> None:
        """Remember a setpoint (n,) of a motion, by which the arm may have to go back."""
        self._retreat.note(q, self.retract_m > 0.0)

    def setpoint(self, override: float) -> Floats | None:
        """The setpoint (n,) of a sample off the path; None on it. Raises what `KeptPath.way_back` raises."""
        if self._retreat.fault is not None:
            return self._retreat.step(self._queue.tick, paused=override == 0.0)
        if self._path is None:
            return None
        q = self._path.way_back(self._queue.tick, override)
        if self._path.reached(self._queue.tick):
            self._queue.engine, self._path = self._path.generator, None
        return q
