"""A motion as a program asked for it, from the queue to its end: what call-backs are handed as `Motion`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qrobot.arcl.attributes import TRAJ_CART
from qrobot.arcl.events import ArclEvent
from qrobot.arcl.kinematics import config_word
from qrobot.arcl.options import MotionOptions
from qrobot.arcl.positions import Pos
from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.motion import T6, Goal, MotionMode, MotionSpeed, MoveRequest


@dataclass(frozen=True, eq=False)
class MotionFeedback:
    """One sample of a motion: degrees (mm on a sliding joint), per second, N m (N); ms.

    Attributes:
        t: time of the sample.
        share: how much of the motion is done, 0 to 1.
        joints, rates: measured positions and velocities. Shape (n,).
        setpoint: joint setpoints. Shape (n,).
        torque: commanded; NaN where it is not known. Shape (n,).
    """

    t: float
    share: float
    joints: Floats
    rates: Floats
    setpoint: Floats
    torque: Floats


class Motion:
    """A motion.

    Attributes:
        name: for traces.
        pos: where to.
        options: how.
        t0: time at which it was taken out of the queue, ms; functional transforms count from there.
        begun: the transition into it has begun.
        near: it is nearly complete.
        code: how it ended, None as long as it has not.
    """

    def __init__(self, pos: Pos, options: MotionOptions) -> None:
        self.name = options.name or pos.name
        self.pos = pos
        self.options = options
        self.t0 = 0.0
        self.begun = self.near = False
        self.code: ArclEvent | None = None
        self._goal = self._target()

    @property
    def over(self) -> bool:
        """True when it has ended, or is nearly complete: `MOV_SYNC` waits no longer."""
        return self.near or self.code is not None

    def request(self, speed: MotionSpeed, ta_s: float) -> MoveRequest:
        """The request to the engine."""
        options = self.options
        mode = MotionMode.CARTESIAN if options.traj == TRAJ_CART else MotionMode.JOINT
        branch = None if options.config is None else config_word(options.config)
        return MoveRequest(self.name, self._goal, speed, ta_s, mode, branch)

    def _target(self) -> Goal | Floats:
        """Constant and hold transforms count as they are now."""
        offset, update = self.options.offset, self.options.update
        if not isinstance(self.pos.target, np.ndarray):
            if update is not None and (update is T6 or self.pos.terms.count(update) != 1):
                raise MotionError(f"move to {self.name}: MOV_UPDATE names a transform that stands in it once")
            return self.pos.target.goal(None if offset is None else offset.value)
        if offset is not None or update is not None:
            raise MotionError(f"move to {self.name}: MOV_OFFSET and MOV_UPDATE need a position equation")
        return self.pos.target
